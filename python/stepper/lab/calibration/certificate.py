"""Certificates of a set of measured parameters, on worlds that were drawn after the set was chosen.

With v of n worlds above the margin, Clopper and Pearson's bound gives the largest fraction of worlds above the margin that is plausible. 59
worlds without a violation certify 95 % of worlds with 95 % confidence. If a certificate fails, the set is changed and tried on new worlds.
The probability of an error is divided by the number of planned tries, as in Bonferroni's correction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import count

from stepper.lab.calibration.search import SHARE, Trial
from stepper.lab.study.intervals import greatest_share, trials_for

CONFIDENCE = 0.95
"""Confidence of all tries together."""


@dataclass(frozen=True)
class Certificate:
    """Certificate: in at least 95 % of plausible worlds the outcome differs by at most the margin.

    Attributes:
        trial: Result on the worlds of the certificate.
        confidence: Confidence of this try.
        number: Number of this try, from 1.
        tries: Number of planned tries.
    """

    trial: Trial
    confidence: float
    number: int
    tries: int

    @property
    def bound(self) -> float:
        """Largest plausible fraction of worlds above the margin."""
        return greatest_share(self.trial.violations, self.trial.worlds, self.confidence)

    @property
    def holds(self) -> bool:
        """Whether the certificate holds."""
        return self.bound <= 1.0 - SHARE + 1e-12


def confidence_of(tries: int) -> float:
    """Confidence of each try, so that all tries together have the confidence `CONFIDENCE`."""
    return 1.0 - (1.0 - CONFIDENCE) / tries


def worlds_for(violations: int, tries: int) -> int:
    """Smallest number of worlds for a certificate with this number of violations."""
    first = trials_for(SHARE, confidence_of(tries))
    return next(n for n in count(first) if greatest_share(violations, n, confidence_of(tries)) <= 1.0 - SHARE)


def of_recordings(recordings: int) -> float:
    """Fraction of recordings for which a claim without a violation in n held-out recordings holds, with 95 % confidence: 0.05^(1/n)."""
    return math.exp(math.log(1.0 - CONFIDENCE) / recordings)
