"""Distributions of outcomes: differences of mean outcomes and of success rates from those of a chart's reference.

These differences stay meaningful in chaotic motion, where single motions cannot be compared. Episode k of every run has the same start and
the same random controls, so that differences are computed per episode. In chaotic motion, the outcomes of an episode in two runs are nearly
independent. Otherwise they correlate, and the interval is narrower.
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
    """Difference between an outcome with some settings and the same outcome in the reference (converged run or closed form).

    Attributes:
        name: "mean NAME" (of an outcome) or "successes" (fraction of successful episodes).
        value: Value with the settings minus the value in the reference; NaN if the time budget stopped one of the two runs.
        low: Lower end of the 95 % interval of the difference; NaN with a single episode.
        high: Upper end of the interval.
        count: Number of compared episodes: for a mean those that were finite in both runs, for "successes" all.
    """

    name: str
    value: float
    low: float
    high: float
    count: int

    @property
    def words(self) -> str:
        """Text of the difference and of its interval."""
        if math.isnan(self.value):
            return "-"
        return f"{self.value:+.3g}" + ("" if math.isnan(self.low) else f" [{self.low:+.3g}, {self.high:+.3g}]")


def names(study: Study) -> list[str]:
    """Names of the compared quantities: the mean of every outcome, and the fraction of successes."""
    return [f"mean {outcome.name}" for outcome in study.all_outcomes] + (["successes"] if study.success_outcome else [])


def shifts(study: Study, own: Trace, converged: Trace) -> list[Shift]:
    """Differences between a run and the reference: in the mean of each outcome, and in the fraction of successes.

    The interval of a mean is Student's, for paired differences. The interval of the fraction of successes combines two Wilson intervals
    (R. G. Newcombe's tenth method, Statistics in Medicine 17, 1998). This interval assumes independent samples, and is too wide if the two
    runs correlate. An episode that was not finite counts as a failure.
    """
    if own.stopped or converged.stopped:
        return [Shift(name, math.nan, math.nan, math.nan, 0) for name in names(study)]
    found = []
    for outcome in study.all_outcomes:
        apart = own.outcomes[outcome.name] - converged.outcomes[outcome.name]
        apart = apart[np.isfinite(apart)]
        low, high = student(apart.tolist()) if len(apart) > 1 else (math.nan, math.nan)
        found.append(Shift(f"mean {outcome.name}", float(apart.mean()) if len(apart) else math.nan, low, high, len(apart)))
    if study.success_outcome is not None:
        name, n = study.success_outcome.name, len(own.qpos)
        one, two = (int(study.success_outcome.succeeds(trace.outcomes[name]).sum()) for trace in (own, converged))
        found.append(Shift("successes", (one - two) / n, *newcombe(one, two, n), n))
    return found


def newcombe(one: int, two: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Confidence interval of a difference of two success rates, one / trials - two / trials, by Newcombe's method."""
    p, q = one / trials, two / trials
    (a, b), (c, d) = wilson(one, trials, confidence), wilson(two, trials, confidence)
    return p - q - math.hypot(p - a, d - q), p - q + math.hypot(b - p, q - c)
