"""Outcomes where single motions mean nothing: by how much their mean, or the share of successes, differs from that of the converged runs.

Episode k of every run begins alike and has the same random controls, so that differences are taken episode by episode. Where motions are
chaotic the pairs are as good as independent, and the interval is as wide as that makes it; where they are not, it is narrower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepper.lab.accuracy.traces import Trace
from stepper.lab.study.intervals import student, wilson
from stepper.lab.study.study import Study


@dataclass(frozen=True)
class Shift:
    """By how much outcomes of some settings differ from those of the converged runs.

    Attributes:
        name: "mean NAME" or "successes".
        value: Settings' own less the reference's; NaN where the clock stopped either.
        low: Lower end of the interval that has the true difference with 95 %; NaN of one episode.
        high: Its upper end.
        count: Episodes of which it was computed: those that were finite in both.
    """

    name: str
    value: float
    low: float
    high: float
    count: int

    @property
    def words(self) -> str:
        """The difference with its interval."""
        if math.isnan(self.value):
            return "-"
        return f"{self.value:+.3g}" + ("" if math.isnan(self.low) else f" [{self.low:+.3g}, {self.high:+.3g}]")


def names(study: Study) -> list[str]:
    """What is compared: the mean of every outcome, and the share of successes."""
    return [f"mean {outcome.name}" for outcome in study.all_outcomes] + (["successes"] if study.decisive else [])


def shifts(study: Study, own: Trace, right: Trace) -> list[Shift]:
    """Differences of outcomes, as of `names`.

    The interval of a mean is Student's, of differences of pairs. That of successes is R. G. Newcombe's tenth method (Statistics in
    Medicine 17, 1998), of two of Wilson's intervals, for independent samples: pairs that go together make it no less safe. An episode that
    was not finite is no success.

    Args:
        study: The study.
        own: Episodes with the settings.
        right: The converged runs.
    """
    if own.stopped or right.stopped:
        return [Shift(name, math.nan, math.nan, math.nan, 0) for name in names(study)]
    found = []
    for outcome in study.all_outcomes:
        apart = own.outcomes[outcome.name] - right.outcomes[outcome.name]
        apart = apart[np.isfinite(apart)]
        low, high = student(apart.tolist()) if len(apart) > 1 else (math.nan, math.nan)
        found.append(Shift(f"mean {outcome.name}", float(apart.mean()) if len(apart) else math.nan, low, high, len(apart)))
    if study.decisive is not None:
        name, n = study.decisive.name, len(own.qpos)
        one, two = (int(study.decisive.succeeds(trace.outcomes[name]).sum()) for trace in (own, right))
        found.append(Shift("successes", (one - two) / n, *newcombe(one, two, n), n))
    return found


def newcombe(one: int, two: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a difference of two shares, of as many trials each."""
    p, q = one / trials, two / trials
    (a, b), (c, d) = wilson(one, trials, confidence), wilson(two, trials, confidence)
    return p - q - math.hypot(p - a, d - q), p - q + math.hypot(b - p, q - c)
