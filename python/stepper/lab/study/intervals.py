"""Confidence intervals of probabilities, computed by SciPy: Wilson's, and Clopper and Pearson's."""

from __future__ import annotations

import math
from typing import Any

from stepper.shared.machine import require


def _trial(successes: int, trials: int, alternative: str) -> Any:
    """Result of SciPy's binomial test, from which confidence intervals are computed."""
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"{successes} successes of {trials} trials: there must be a trial, and no more successes than trials")
    return require("scipy.stats", "to compute intervals").binomtest(int(successes), int(trials), alternative=alternative)


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a probability (E. B. Wilson, JASA 22, 1927).

    Returns:
        Lower and upper end.
    """
    low, high = _trial(successes, trials, "two-sided").proportion_ci(confidence, method="wilson")
    return float(low), float(high)


def least_share(successes: int, trials: int, confidence: float = 0.95) -> float:
    """Lower bound of a probability, by Clopper and Pearson (Biometrika 26, 1934); exact for any number of trials.

    It is the probability p at which at least `successes` of the trials succeed with the probability 1 - confidence.
    """
    return float(_trial(successes, trials, "greater").proportion_ci(confidence, method="exact").low)


def greatest_share(successes: int, trials: int, confidence: float = 0.95) -> float:
    """Upper bound of a probability, by Clopper and Pearson; exact for any number of trials. It is the counterpart of `least_share`."""
    return float(_trial(successes, trials, "less").proportion_ci(confidence, method="exact").high)


def trials_for(share: float, confidence: float) -> int:
    """Number of trials that must all succeed to prove that the probability of success is at least `share`.

    It is ln(1 - confidence) / ln(share), rounded up.
    """
    return math.ceil(math.log(1 - confidence) / math.log(share))
