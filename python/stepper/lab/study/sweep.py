"""Sweep of a study: variation of one parameter at a time over its range, and bisection for the values at which success ends (cliffs)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from stepper._status import Status
from stepper.lab.study.batches import USUAL, Point, inapplicable, nominal_of, run_points
from stepper.lab.study.intervals import wilson
from stepper.lab.study.journal import Journal, Row, Table, diverged
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import COUNTS, Value, check_effects, selected
from stepper.lab.study.study import Study
from stepper.shared.arguments import check_fraction
from stepper.shared.progress import ProgressCallback

CLIFF = 0.5
"""Fraction of successes that defines a cliff, which is a value of a parameter at which success ends.

On one side of a cliff the fraction is at least this large, and on the other side it is smaller.
"""
RESOLUTION = 1e-3
"""Default width of the interval to which bisection locates a cliff, as a fraction of the parameter's range."""
_POINTS_PER_ROUND = 7
"""Number of values between the ends of an interval that one round of the bisection runs as one batch."""
Bisected = list[tuple[float, list[Row]]]
"""Values of a parameter, each with the rows (results) of its episodes."""
UNSOLVED = Status.NOT_CONVERGED | Status.NON_FINITE | Status.CONTACTS_FULL | Status.UNRESOLVED | Status.TUNNELLED | Status.INFEASIBLE
"""Flags of steps that were not solved reliably."""


@dataclass(frozen=True)
class Statistics:
    """Statistics of an outcome over the episodes at one value of one parameter. Episodes that diverged are left out.

    Attributes:
        mean: Mean of the outcome; NaN if all episodes diverged.
        spread: Standard deviation of the outcome.
        change: Mean change of the outcome compared with the same episodes at the nominal point, and the standard error of this mean.
    """

    mean: float
    spread: float
    change: tuple[float, float]


@dataclass(frozen=True)
class Level:
    """Statistics of the episodes at one value of one parameter, or at the nominal point, where all parameters are nominal.

    At a value of a parameter, all other parameters are nominal. The main outcome is the one with a condition of success, or otherwise the
    first outcome of the study.

    Attributes:
        setting: Name of the settings.
        parameter: Name of the parameter; an empty string at the nominal point.
        value: Value of the parameter; None at the nominal point.
        episodes: Number of episodes.
        successes: Number of successful episodes; None if the study has no condition of success.
        different: Number of distinct episodes. Without random starts or controllers, episodes may repeat one another bit for bit.
        interval: Wilson's 95 % interval of the fraction of successes; NaN without a condition of success or if episodes repeat one another.
        mean, spread, change: `Statistics` of the main outcome.
        unsolved: Number of episodes with at least one step that was not solved reliably (flags `UNSOLVED`).
        diverged: Number of episodes that diverged. They have no outcome and count as failures.
        others: `Statistics` of the study's other outcomes, by name.
    """

    setting: str
    parameter: str
    value: Value | None
    episodes: int
    successes: int | None
    different: int
    interval: tuple[float, float]
    mean: float
    spread: float
    change: tuple[float, float]
    unsolved: int
    diverged: int
    others: Mapping[str, Statistics] = field(default_factory=dict)

    def of(self, outcome: str) -> Level | Statistics:
        """Mean, spread and change of an outcome of the study, by name: of one of `others`, or otherwise of the main outcome."""
        return self.others.get(outcome, self)

    @property
    def share(self) -> float:
        """Fraction of successes; NaN if the study has no condition of success."""
        return math.nan if self.successes is None else self.successes / self.episodes


@dataclass(frozen=True)
class Cliff:
    """Interval of a parameter's values in which the fraction of successes crosses one half.

    Attributes:
        setting: Name of the settings.
        parameter: Name of the parameter.
        low: Lower end of the interval, in the parameter's unit.
        high: Upper end of the interval.
        below: Fraction of successes at `low`.
        above: Fraction of successes at `high`.
    """

    setting: str
    parameter: str
    low: float
    high: float
    below: float
    above: float


@dataclass(frozen=True)
class Sweep:
    """Result of a sweep.

    Attributes:
        study: The study.
        levels: Statistics at each value of a parameter. The first entries are the nominal points with all settings. The others are sorted
            by settings, then parameters, then values.
        cliffs: Values of parameters at which success ends.
        table: Table of all episodes.
        skipped: Texts on parameters that were not varied with some settings, with the reasons.
        bisected: Statistics at the further values of parameters that the bisections ran to locate cliffs.
    """

    study: Study
    levels: tuple[Level, ...]
    cliffs: tuple[Cliff, ...]
    table: Table
    skipped: tuple[str, ...] = field(default=())
    bisected: tuple[Level, ...] = field(default=())

    def levels_of(self, parameter: str, setting: str = USUAL) -> list[Level]:
        """Statistics of the outcomes at each value of a parameter in the sweep.

        Args:
            parameter: Name of the parameter; an empty string selects the nominal point.
            setting: Name of the settings with which the episodes ran.
        """
        return [level for level in self.levels if (level.parameter, level.setting) == (parameter, setting)]

    def points(self, parameter: str, setting: str = USUAL) -> list[Level]:
        """Statistics of the outcomes at all values of a parameter: those of the sweep, and those that bisection added.

        If the values are numbers, they are in ascending order.

        Args:
            parameter: Name of the parameter.
            setting: Name of the settings with which the episodes ran.
        """
        found = self.levels_of(parameter, setting)
        found += [level for level in self.bisected if (level.parameter, level.setting) == (parameter, setting)]
        words = any(isinstance(level.value, str) for level in found)
        return found if words else sorted(found, key=lambda level: float(level.value or 0))

    @property
    def ranking(self) -> list[tuple[str, float]]:
        """Parameters in descending order of their effect, with the study's default settings.

        Returns:
            Pairs of name and effect. The effect is the largest minus the smallest fraction of successes over the values of the parameter.
            If the study has no condition of success, it is the same difference of mean outcomes.
        """
        found = []
        for name in self.study.parameters:
            values = [level.mean if self.study.success_outcome is None else level.share for level in self.levels_of(name)]
            values = [value for value in values if math.isfinite(value)]
            if values:
                found.append((name, float(np.ptp(values))))
        return sorted(found, key=lambda entry: -entry[1])


def run_sweep(
    study: Study,
    journal: Journal,
    *,
    parameters: Sequence[str] | None = None,
    cliffs: bool = True,
    resolution: float = RESOLUTION,
    progress: ProgressCallback | None = None,
) -> Sweep:
    """Vary one parameter at a time over its range, with all settings of a study.

    Returns:
        Statistics at each value of a parameter (levels), and the values at which success ends (cliffs).
    """
    check_fraction("resolution", resolution, ": the width of a cliff's bracket over the range")
    if not study.all_outcomes:
        raise ValueError("the study has no outcome, so there is nothing to compare; give it one")
    chosen = study.parameters if parameters is None else selected(study.parameters, parameters, study.loaded[0])
    names, study = list(chosen), replace(study, parameters={**study.parameters, **chosen})
    check_effects(names, study.parameters, study.loaded[0])
    settings, skipped = [USUAL, *study.settings], []
    cells: list[tuple[str, str, Value | None]] = [(setting, "", None) for setting in settings]
    for setting in settings:
        for name in names:
            if reason := inapplicable(study, setting, study.parameters[name]):
                skipped.append(f"{name} with {setting}: {reason}")
                continue
            cells += [(setting, name, value) for value in study.parameters[name].levels()]
    points = [_point(study, cell) for cell in cells]
    rows = run_points(study, points, journal, None if progress is None else lambda done: progress(f"sweep {study.name}", done))
    n = study.episodes
    by_cell = {cell: rows[k * n : (k + 1) * n] for k, cell in enumerate(cells)}
    levels = [_level(study, cell, found, by_cell[cell[0], "", None]) for cell, found in by_cell.items()]
    every = list(rows)
    ends: list[Cliff] = []
    between: list[Level] = []
    if cliffs and study.success_outcome is not None:
        groups = [[level for level in levels if (level.setting, level.parameter) == (s, name)] for s in settings for name in names]
        brackets = [bracket for own in groups for bracket in _brackets(study, own, resolution)]
        rounds = _Progress(f"cliffs of {study.name}", sum(_rounds(*bracket) for bracket in brackets), progress)
        for one, other, width in brackets:
            cliff, bisected = _bisect(study, one, other, width, lambda points: _shares(study, points, journal, rounds))
            ends.append(cliff)
            for value, more in bisected:
                every += more
                between.append(_level(study, (one.setting, one.parameter, value), more, by_cell[one.setting, "", None]))
        rounds.end()
    return Sweep(study, tuple(levels), tuple(ends), Table(every), tuple(skipped), tuple(between))


def _point(study: Study, cell: tuple[str, str, Value | None]) -> Point:
    """Point of a study: a given value of one parameter, and nominal values of all others."""
    setting, name, value = cell
    return Point(nominal_of(study, setting) | ({} if value is None else {name: value}), setting)


def ordered_outcomes(study: Study) -> list[Outcome]:
    """All outcomes of a study. The main one is first: the outcome with a condition of success, or the first of the study."""
    return sorted(study.all_outcomes, key=lambda outcome: outcome.success is None)


def measured(study: Study) -> str:
    """Name of the main outcome of a study: the one with a condition of success, or the first."""
    return ordered_outcomes(study)[0].name


def main_values(study: Study, rows: Sequence[Row]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Success of episodes, (n,), 1 or 0 without unit; without a condition of success their main outcome, in its unit."""
    name = measured(study)
    return np.array([row["outcomes"][name] if study.success_outcome is None else row["success"] for row in rows], float)


def _level(study: Study, cell: tuple[str, str, Value | None], rows: Sequence[Row], nominal: Sequence[Row]) -> Level:
    """Statistics of the episodes of a cell: settings, parameter ("" for the nominal point) and value.

    `nominal` has the rows of the same episodes at the nominal point.
    """
    main = measured(study)
    found = {outcome.name: _statistics(outcome.name, rows, nominal) for outcome in study.all_outcomes}
    successes = None if study.success_outcome is None else sum(row["success"] for row in rows)
    different = _different(study, rows)
    return Level(
        setting=cell[0],
        parameter=cell[1],
        value=cell[2],
        episodes=len(rows),
        successes=successes,
        different=different,
        interval=(math.nan, math.nan) if successes is None or different < len(rows) else wilson(successes, len(rows)),
        mean=found[main].mean,
        spread=found[main].spread,
        change=found[main].change,
        unsolved=sum(bool(int(row["quality"]["status"]) & UNSOLVED) for row in rows),
        diverged=sum(map(diverged, rows)),
        others={name: own for name, own in found.items() if name != main},
    )


def _statistics(outcome: str, rows: Sequence[Row], nominal: Sequence[Row]) -> Statistics:
    """Statistics of an outcome over episodes."""
    pairs = [
        (row["outcomes"][outcome], was["outcomes"][outcome], diverged(was))
        for row, was in zip(rows, nominal, strict=True)
        if not diverged(row)
    ]
    values = np.array([value for value, *_ in pairs], float)
    change = np.array([value - before for value, before, lost in pairs if not lost], float)
    return Statistics(
        mean=float(values.mean()) if len(values) else math.nan,
        spread=_deviation(values),
        change=(float(change.mean()), _deviation(change) / math.sqrt(len(change))) if len(change) else (math.nan, math.nan),
    )


def _different(study: Study, rows: Sequence[Row]) -> int:
    """Number of episodes that differ from one another.

    With random initial states or controls, all episodes count as different. Otherwise, episodes with equal results count once.
    """
    if study.qpos_noise or study.qvel_noise or (study.controller == "random" and study.loaded[0].nu):
        return len(rows)
    return len({json.dumps([row["outcomes"], row["quality"]], sort_keys=True) for row in rows})


def _deviation(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Standard deviation of a sample; NaN for a single value."""
    return float(values.std(ddof=1)) if len(values) > 1 else math.nan


class _Progress:
    """Progress of all bisections together, counted in rounds, for a progress callback.

    Args:
        what: Text for the callback.
        rounds: Number of rounds of all bisections.
        progress: Progress callback; None reports nothing.
    """

    def __init__(self, what: str, rounds: int, progress: ProgressCallback | None):
        self._what, self._rounds, self._report, self._done = what, rounds, progress, 0

    def of_round(self, done: float) -> None:
        """Reports the completed fraction of the current round of a bisection."""
        if self._report is not None:
            # Only `end` reports 1, because a bisection may need fewer rounds than predicted.
            self._report(self._what, min((self._done + done) / self._rounds, 0.99))
        self._done += done == 1.0

    def end(self) -> None:
        """Reports to the progress callback that all bisections have ended. Does nothing if there were no bisections."""
        if self._report is not None and self._rounds:
            self._report(self._what, 1.0)


def _brackets(study: Study, levels: Sequence[Level], resolution: float) -> list[tuple[Level, Level, float]]:
    """Intervals for bisections: pairs of neighbouring values of a parameter between which success ends, and width at which to stop.

    The list is empty if the values are counts or words.
    """
    numeric = [level for level in levels if isinstance(level.value, int | float) and not isinstance(level.value, bool)]
    if not levels or study.parameters[levels[0].parameter].leaf in COUNTS:
        return []
    numeric.sort(key=lambda level: float(level.value or 0))
    width = resolution * abs(float(numeric[-1].value or 0) - float(numeric[0].value or 0)) if numeric else 0.0
    return [(one, other, width) for one, other in pairwise(numeric) if (one.share >= CLIFF) != (other.share >= CLIFF)]


def _rounds(one: Level, other: Level, width: float) -> int:
    """Number of rounds in which a bisection narrows the interval between two values of a parameter to a given width."""
    apart = abs(float(other.value or 0) - float(one.value or 0))
    return max(1, math.ceil(math.log(apart / width) / math.log(_POINTS_PER_ROUND + 1) - 1e-9)) if apart > width else 0


def _shares(study: Study, points: Sequence[Point], journal: Journal, rounds: _Progress) -> list[tuple[float, list[Row]]]:
    """Runs the episodes of some points (sets of parameter values), and returns the fraction of successes and the results at each point."""
    rows = run_points(study, points, journal, rounds.of_round)
    n = study.episodes
    cut = [rows[k * n : (k + 1) * n] for k in range(len(points))]
    return [(sum(row["success"] for row in own) / n, own) for own in cut]


def _bisect(
    study: Study, one: Level, other: Level, width: float, run: Callable[[Sequence[Point]], list[tuple[float, list[Row]]]]
) -> tuple[Cliff, Bisected]:
    """Locates the value of a parameter at which success ends (cliff), by bisection. Each round runs several values at once.

    Returns the cliff, and all values that were run, with their rows.
    """
    assert isinstance(one.value, int | float)
    assert isinstance(other.value, int | float)
    low, high, below, above = float(one.value), float(other.value), one.share, other.share
    every: Bisected = []
    steps = study.parameters[one.parameter].leaf == "timestep"
    while high - low > width:
        inner = [float(x) for x in np.linspace(low, high, _POINTS_PER_ROUND + 2)[1:-1]]
        if steps:
            # Values are rounded to time steps that divide the control period.
            inner = [study.control_period / round(study.control_period / x) for x in inner]
        values = [low, *sorted({x for x in inner if low < x < high}), high]
        if len(values) == 2:
            # No number, or no such time step, is between the ends.
            break
        inside = run([_point(study, (one.setting, one.parameter, x)) for x in values[1:-1]])
        every += [(value, own) for value, (_, own) in zip(values[1:-1], inside, strict=True)]
        shares = [below, *(share for share, _ in inside), above]
        k = next(k for k in range(1, len(shares)) if (shares[k] >= CLIFF) != (shares[0] >= CLIFF))
        low, high, below, above = values[k - 1], values[k], shares[k - 1], shares[k]
    return Cliff(one.setting, one.parameter, low, high, below, above), every
