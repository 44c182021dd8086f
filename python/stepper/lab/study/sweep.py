"""The perturbation table of a study: every parameter through its range, one at a time, with intervals; and where success ends."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from stepper._status import Status
from stepper.lab.progress import Tick
from stepper.lab.study.batches import run_points
from stepper.lab.study.intervals import wilson
from stepper.lab.study.journal import Journal, Row, diverged
from stepper.lab.study.parameters import COUNTS, Value, asked_for
from stepper.lab.study.points import USUAL, Point, inapplicable, nominal_of
from stepper.lab.study.study import Study
from stepper.lab.study.table import Table

CLIFF = 0.5
"""Share of successes that is crossed at a cliff."""
RESOLUTION = 1e-3
"""Width of a cliff's bracket over the range of its parameter."""
_AT_ONCE = 7
"""Points between the ends of a bracket that are tried together: they share a batch."""
Tried = list[tuple[float, list[Row]]]
"""Values of a parameter with the episodes of each."""
UNSOLVED = Status.NOT_CONVERGED | Status.NON_FINITE | Status.CONTACTS_FULL | Status.UNRESOLVED | Status.TUNNELLED | Status.INFEASIBLE


@dataclass(frozen=True)
class Level:
    """Episodes at one value of one parameter, all else nominal.

    Attributes:
        setting: Name of the settings.
        parameter: Its name; "" is the nominal point.
        value: Its value; None at the nominal point.
        episodes: How many.
        successes: How many of them; None where the study has no success.
        different: How many episodes do not repeat another one bit for bit, which without noise of the start or a random drive all may do.
        interval: Wilson's of the share of successes, 95 %; NaN where episodes repeat one another, which are no independent trials.
        mean: Of the outcome that decides, or the first one, of the episodes that did not diverge; NaN where all did.
        spread: Standard deviation over episodes.
        change: Mean over episodes of the difference from the same episode at the nominal point, of those that diverged in neither; its
            standard error.
        unsolved: Episodes in which a step says that it could not be taken as it should.
        diverged: Those of them that diverged, which have no outcome and are no success.
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

    @property
    def share(self) -> float:
        """Share of successes; NaN without any to count."""
        return math.nan if self.successes is None else self.successes / self.episodes


@dataclass(frozen=True)
class Cliff:
    """Where success ends as a parameter grows.

    Attributes:
        setting: Name of the settings.
        parameter: Its name.
        low: Below it success is `below`.
        high: Above it success is `above`.
        below: Share of successes at `low`.
        above: Share of successes at `high`.
    """

    setting: str
    parameter: str
    low: float
    high: float
    below: float
    above: float


@dataclass(frozen=True)
class Sweep:
    """What a sweep found.

    Attributes:
        study: What was swept.
        levels: By settings, then parameters, then values; the nominal point first.
        cliffs: Where success ends.
        table: All episodes.
        skipped: What was not run, with the reason.
        bisected: Levels between those, at which the ends of success were located.
    """

    study: Study
    levels: tuple[Level, ...]
    cliffs: tuple[Cliff, ...]
    table: Table
    skipped: tuple[str, ...] = field(default=())
    bisected: tuple[Level, ...] = field(default=())

    def levels_of(self, parameter: str, setting: str = USUAL) -> list[Level]:
        """Levels of a parameter ("" is the nominal point) with settings."""
        return [level for level in self.levels if (level.parameter, level.setting) == (parameter, setting)]

    def points(self, parameter: str, setting: str = USUAL) -> list[Level]:
        """Levels of a parameter with settings, those of bisections among them, in the order of their values where these are numbers."""
        found = self.levels_of(parameter, setting)
        found += [level for level in self.bisected if (level.parameter, level.setting) == (parameter, setting)]
        words = any(isinstance(level.value, str) for level in found)
        return found if words else sorted(found, key=lambda level: float(level.value or 0))

    @property
    def ranking(self) -> list[tuple[str, float]]:
        """Parameters by how far the outcome moves over their range, with the study's own settings.

        Returns:
            (name, range of the share of successes, or of the mean of what has no success).
        """
        found = []
        for name in self.study.parameters:
            values = [level.mean if self.study.decisive is None else level.share for level in self.levels_of(name)]
            values = [value for value in values if math.isfinite(value)]
            if values:
                found.append((name, float(np.ptp(values))))
        return sorted(found, key=lambda entry: -entry[1])


def sweep(
    study: Study,
    journal: Journal,
    *,
    parameters: Sequence[str] | None = None,
    cliffs: bool = True,
    resolution: float = RESOLUTION,
    tick: Tick | None = None,
) -> Sweep:
    """Takes every parameter through its range, one at a time, with all settings of a study.

    Args:
        study: The study; it must have parameters and an outcome.
        journal: What is known of it.
        parameters: Names, or selectors with a range, as "geom_friction[floor][0]=0.2..1"; None is all of the study.
        cliffs: Whether the end of success is located.
        resolution: Width of a cliff's bracket over the range of its parameter, between 0 and 1.
        tick: Progress.

    Returns:
        Levels and cliffs.

    Raises:
        ValueError: No outcome, an unknown parameter, a resolution that is none.
    """
    if not 0 < resolution < 1:
        raise ValueError(f"resolution is {resolution}, must be between 0 and 1: the width of a cliff's bracket over the range")
    if not study.all_outcomes:
        raise ValueError("the study has no outcome, so there is nothing to compare; give it one")
    chosen = study.parameters if parameters is None else asked_for(study.parameters, parameters, study.loaded[0])
    names, study = list(chosen), replace(study, parameters={**study.parameters, **chosen})
    settings, skipped = [USUAL, *study.settings], []
    cells: list[tuple[str, str, Value | None]] = [(setting, "", None) for setting in settings]
    for setting in settings:
        for name in names:
            if reason := inapplicable(study, setting, study.parameters[name]):
                skipped.append(f"{name} with {setting}: {reason}")
                continue
            cells += [(setting, name, value) for value in study.parameters[name].levels()]
    points = [_point(study, cell) for cell in cells]
    rows = run_points(study, points, journal, None if tick is None else lambda done: tick(f"sweep {study.name}", done))
    n = study.episodes
    by_cell = {cell: rows[k * n : (k + 1) * n] for k, cell in enumerate(cells)}
    levels = [_level(study, cell, found, by_cell[cell[0], "", None]) for cell, found in by_cell.items()]
    every = list(rows)
    ends: list[Cliff] = []
    between: list[Level] = []
    if cliffs and study.decisive is not None:
        groups = [[level for level in levels if (level.setting, level.parameter) == (s, name)] for s in settings for name in names]
        brackets = [bracket for own in groups for bracket in _brackets(study, own, resolution)]
        progress = _Progress(f"cliffs of {study.name}", sum(_rounds(*bracket) for bracket in brackets), tick)
        for one, other, width in brackets:
            cliff, tried = _bisect(study, one, other, width, lambda points: _shares(study, points, journal, progress))
            ends.append(cliff)
            for value, more in tried:
                every += more
                between.append(_level(study, (one.setting, one.parameter, value), more, by_cell[one.setting, "", None]))
        progress.end()
    return Sweep(study, tuple(levels), tuple(ends), Table(every), tuple(skipped), tuple(between))


def _point(study: Study, cell: tuple[str, str, Value | None]) -> Point:
    setting, name, value = cell
    theta = nominal_of(study, setting)
    if value is not None:
        theta[name] = value
    return Point(theta, setting)


def measured(study: Study) -> str:
    """Name of the outcome that a table shows: the one that decides, or the first."""
    return (study.decisive or study.all_outcomes[0]).name


def _level(study: Study, cell: tuple[str, str, Value | None], rows: Sequence[Row], nominal: Sequence[Row]) -> Level:
    name = measured(study)
    pairs = [
        (row["outcomes"][name], was["outcomes"][name], diverged(was)) for row, was in zip(rows, nominal, strict=True) if not diverged(row)
    ]
    values = np.array([value for value, *_ in pairs], float)
    change = np.array([value - before for value, before, lost in pairs if not lost], float)
    successes = None if study.decisive is None else sum(row["success"] for row in rows)
    different = _different(study, rows)
    return Level(
        setting=cell[0],
        parameter=cell[1],
        value=cell[2],
        episodes=len(rows),
        successes=successes,
        different=different,
        interval=(math.nan, math.nan) if successes is None or different < len(rows) else wilson(successes, len(rows)),
        mean=float(values.mean()) if len(values) else math.nan,
        spread=_deviation(values),
        change=(float(change.mean()), _deviation(change) / math.sqrt(len(change))) if len(change) else (math.nan, math.nan),
        unsolved=sum(bool(int(row["certificate"]["status"]) & UNSOLVED) for row in rows),
        diverged=sum(map(diverged, rows)),
    )


def _different(study: Study, rows: Sequence[Row]) -> int:
    """Episodes that differ: all where starts have noise or controls are random, else those whose rows do."""
    if study.qpos_noise or study.qvel_noise or (study.drive == "random" and study.loaded[0].nu):
        return len(rows)
    return len({json.dumps([row["outcomes"], row["certificate"]], sort_keys=True) for row in rows})


def _deviation(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else math.nan


class _Progress:
    """Progress of the rounds of all bisections, as one."""

    def __init__(self, what: str, rounds: int, tick: Tick | None):
        self._what, self._rounds, self._tick, self._done = what, rounds, tick, 0

    def of_round(self, done: float) -> None:
        """Tells the fraction that is done of the round under way."""
        if self._tick is not None:
            # The end is told once: a time step has fewer values between two than a number.
            self._tick(self._what, min((self._done + done) / self._rounds, 0.99))
        self._done += done == 1.0

    def end(self) -> None:
        """Tells the end, if there were rounds."""
        if self._tick is not None and self._rounds:
            self._tick(self._what, 1.0)


def _brackets(study: Study, levels: Sequence[Level], resolution: float) -> list[tuple[Level, Level, float]]:
    """Neighbouring levels of a parameter with a cliff between them, and the width to which each bracket is narrowed."""
    numeric = [level for level in levels if isinstance(level.value, int | float) and not isinstance(level.value, bool)]
    if study.parameters[levels[0].parameter].leaf in COUNTS if levels else True:
        return []
    numeric.sort(key=lambda level: float(level.value or 0))
    width = resolution * abs(float(numeric[-1].value or 0) - float(numeric[0].value or 0)) if numeric else 0.0
    return [(one, other, width) for one, other in pairwise(numeric) if (one.share >= CLIFF) != (other.share >= CLIFF)]


def _rounds(one: Level, other: Level, width: float) -> int:
    """Rounds of a bisection that narrows a bracket to a width."""
    apart = abs(float(other.value or 0) - float(one.value or 0))
    return max(1, math.ceil(math.log(apart / width) / math.log(_AT_ONCE + 1) - 1e-9)) if apart > width else 0


def _shares(study: Study, points: Sequence[Point], journal: Journal, progress: _Progress) -> list[tuple[float, list[Row]]]:
    rows = run_points(study, points, journal, progress.of_round)
    n = study.episodes
    cut = [rows[k * n : (k + 1) * n] for k in range(len(points))]
    return [(sum(row["success"] for row in own) / n, own) for own in cut]


def _bisect(
    study: Study, one: Level, other: Level, width: float, run: Callable[[Sequence[Point]], list[tuple[float, list[Row]]]]
) -> tuple[Cliff, Tried]:
    """The cliff between two levels, with a bracket no wider than a width: each round tries some points at once."""
    assert isinstance(one.value, int | float)
    assert isinstance(other.value, int | float)
    low, high, below, above = float(one.value), float(other.value), one.share, other.share
    every: Tried = []
    steps = study.parameters[one.parameter].leaf == "timestep"
    while high - low > width:
        inner = [float(x) for x in np.linspace(low, high, _AT_ONCE + 2)[1:-1]]
        if steps:
            # Only steps that divide the time of a control.
            inner = [study.hold / round(study.hold / x) for x in inner]
        values = [low, *sorted({x for x in inner if low < x < high}), high]
        if len(values) == 2:
            # No number, or no such step, is between the ends.
            break
        tried = run([_point(study, (one.setting, one.parameter, x)) for x in values[1:-1]])
        every += [(value, own) for value, (_, own) in zip(values[1:-1], tried, strict=True)]
        shares = [below, *(share for share, _ in tried), above]
        k = next(k for k in range(1, len(shares)) if (shares[k] >= CLIFF) != (shares[0] >= CLIFF))
        low, high, below, above = values[k - 1], values[k], shares[k - 1], shares[k]
    return Cliff(one.setting, one.parameter, low, high, below, above), every
