"""Points of a chart: errors, costs, invariants and outcomes of some settings with a given time step.

Differences of outcomes from those of the reference stay meaningful in chaotic motion, where single motions cannot be compared. Episode k of
every run has the same start and the same random controls, so that differences are computed per episode. In chaotic motion, the outcomes of
an episode in two runs are nearly independent. Otherwise they correlate, and the interval is narrower.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from stepper.lab.accuracy.candidates import pareto
from stepper.lab.accuracy.traces import Trace
from stepper.lab.study.intervals import student, wilson
from stepper.lab.study.study import Study

CAUSES = {"solver": "solver", "step": "time step", "model": "model"}
"""Causes of an error, as words for tables and pictures. Keys are the attributes of `Dot` with the part of the error from a cause."""


@dataclass(frozen=True)
class Shift:
    """Difference between an outcome with some settings and the same outcome in the reference (converged run or closed form).

    Attributes:
        name: "mean NAME" (of an outcome) or "successes" (fraction of successful episodes).
        value: Value with the settings minus the value in the reference; NaN if the run was stopped.
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
    if own.stopped:
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


@dataclass(frozen=True)
class Dot:
    """Point of a chart: settings with a given time step. Errors are medians over episodes, in the unit of the distance (m or rad).

    Attributes:
        engine: "stepper" or "MuJoCo".
        setting: Name of the settings.
        timestep: Time step, s.
        error: Largest distance of the run from the reference up to the horizon. It is infinite if the run is not finite, and NaN if
            it was stopped before the horizon.
        min_error: Smallest error of all episodes.
        max_error: Largest error of all episodes.
        solver: Error from the solver: distance of the run from the same run with a tight tolerance (1e-9 m/s) and precision "f64". NaN for
            MuJoCo.
        step: Error from the time step: distance of the run with a tight tolerance from the converged run with the same contact law.
        model: Error from the contact law (softness, friction cone): distance of that converged run from the reference.
        us_single_env: Microseconds of one core for a simulated second of one environment, stepped alone; NaN if not measured.
        batch: Microseconds of one core for a simulated second of one environment, stepped in a batch; NaN if not measured.
        depth: Deepest overlap of all episodes in the engine's contacts, m.
        residual: Largest residual of all episodes, m/s; NaN for MuJoCo.
        outcome: Mean of an outcome over finite episodes: the outcome with a condition of success, or otherwise the first outcome. NaN
            without outcomes.
        share: Fraction of successful episodes, where episodes that were not finite are failures; NaN without a condition of success.
        invariants: Largest errors of invariants over all episodes, by name; NaN if not measured.
        shifts: Differences of outcomes from those of the reference.
        notes: Remarks: runs that were stopped, or not finite.
    """

    engine: str
    setting: str
    timestep: float
    error: float
    min_error: float
    max_error: float
    solver: float
    step: float
    model: float
    us_single_env: float
    batch: float
    depth: float
    residual: float
    outcome: float
    share: float
    invariants: dict[str, float]
    shifts: tuple[Shift, ...]
    notes: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label of the chart's line to which this point belongs: name of the engine and name of the settings."""
        return f"{self.engine}: {self.setting}"

    @property
    def cause(self) -> str:
        """Largest cause of the error: "solver", "time step" or "model". An empty string if the error is 0 or one of its parts is unknown.

        For MuJoCo the error from the solver is not known separately, and is included in the error from the time step.
        """
        names = {name: word for name, word in CAUSES.items() if word != "solver" or self.engine == "stepper"}
        parts = {word: float(getattr(self, name)) for name, word in names.items()}
        cause = max(parts, key=lambda word: parts[word])
        return cause if all(map(math.isfinite, [self.error, *parts.values()])) and parts[cause] > 0.0 else ""

    @property
    def row(self) -> dict[str, object]:
        """Row of the chart's table for this point: values by name of the column."""
        return dict(self._columns())

    def _columns(self) -> Iterator[tuple[str, object]]:
        """Yields the name and the value of each column of the chart's table for this point."""
        for own in fields(self):
            if own.name in CAUSES:
                yield f"error from {CAUSES[own.name]}", getattr(self, own.name)
            elif own.name not in ("invariants", "shifts", "notes"):
                yield own.name, getattr(self, own.name)
            if own.name == "model":
                yield "cause", self.cause
        yield from self.invariants.items()
        for shift in self.shifts:
            yield from ((f"shift of {shift.name}", shift.value), (f"{shift.name}, low", shift.low), (f"{shift.name}, high", shift.high))
        yield "notes", "; ".join(self.notes)


def front(dots: Sequence[Dot], cost: str, engine: str | None = None) -> list[Dot]:
    """Pareto front of a chart: points for which no other point is both cheaper and more accurate."""
    own = [dot for dot in dots if math.isfinite(dot.error) and math.isfinite(getattr(dot, cost)) and engine in (None, dot.engine)]
    return [own[k] for k in pareto([getattr(dot, cost) for dot in own], [dot.error for dot in own])]
