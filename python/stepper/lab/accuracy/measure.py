"""Points of a chart: runs of settings at time steps, their errors, and the sources of the errors.

First, all settings run. Then a converged run of each contact law is computed. Last, the runs are repeated with a tight solver tolerance.
Runs that take too long are stopped, and get a note with the reason.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.accuracy.candidates import Line, pareto
from stepper.lab.accuracy.reference import TIGHT, Reference, converge, patience, with_trajectories
from stepper.lab.accuracy.traces import Distance, Trace, run
from stepper.lab.study.study import Study

Array = NDArray[np.float64]

CAUSES = {"solver": "solver", "step": "time step", "model": "model"}
"""Causes of an error, as words for tables and pictures. Keys are the attributes of `Dot` with the part of the error from a cause."""


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
        model: Error from the contact law (softness, friction cone): distance of that converged run from the reference. With measured
            trajectories, which then are the ground truth, it is the error of the model as a whole.
        noise_floor: Error that the noise of the measurement alone causes; NaN without measured trajectories.
        us_single_env: Microseconds of one core for a simulated second of one environment, stepped alone; NaN if not measured.
        batch: Microseconds of one core for a simulated second of one environment, stepped in a batch; NaN if not measured.
        depth: Deepest overlap of all episodes in the engine's contacts, m.
        residual: Largest residual of all episodes, m/s; NaN for MuJoCo.
        outcome: Mean of an outcome over finite episodes: the outcome with a condition of success, or otherwise the first outcome. NaN
            without outcomes.
        share: Fraction of successful episodes, where episodes that were not finite are failures; NaN without a condition of success.
        invariants: Largest errors of invariants over all episodes, by name; NaN if not measured.
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
    noise_floor: float
    us_single_env: float
    batch: float
    depth: float
    residual: float
    outcome: float
    share: float
    invariants: dict[str, float]
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
            elif own.name not in ("invariants", "notes"):
                yield own.name, getattr(self, own.name)
            if own.name == "model":
                yield "cause", self.cause
        yield from self.invariants.items()
        yield "notes", "; ".join(self.notes)


def front(dots: Sequence[Dot], cost: str) -> list[Dot]:
    """Pareto front of a chart: points for which no other point is both cheaper and more accurate."""
    own = [dot for dot in dots if math.isfinite(dot.error) and math.isfinite(getattr(dot, cost))]
    return [own[k] for k in pareto([getattr(dot, cost) for dot in own], [dot.error for dot in own])]


TARGET = {"m": 1e-4, "rad": 1e-3}
"""Target uncertainty of a reference, by unit.

If the user gives no horizon, errors are measured up to the time at which the uncertainty of the reference exceeds this target.
"""
_MAX_SLOWDOWN, _MIN_PATIENCE = 10.0, 10.0
"""Limits of a run's processor time: ratio to the time of the reference's finest run, and a duration in s.

The larger limit applies. Slower runs are stopped, because they have usually diverged.
"""


@dataclass(frozen=True)
class ChartBasis:
    """Data that all points of a chart share.

    Attributes:
        study: The study.
        episodes: Numbers of the episodes.
        distance: Definition of errors: unit and horizon.
        reference: Reference, relative to which errors are measured.
        most: Largest number of halvings of the time step for converged runs.
    """

    study: Study
    episodes: Sequence[int]
    distance: Distance
    reference: Reference
    most: int


@dataclass(frozen=True)
class Point:
    """Run of some settings with a given time step, with its errors.

    Attributes:
        line: Line of the chart, with the settings.
        timestep: Time step, s.
        trace: The run.
        errors: Errors by name ("total", "solver", "step", "model"), (episodes,), m or rad. NaN if a run from which an error is computed was
            stopped.
        notes: Remarks for the table.
    """

    line: Line
    timestep: float
    trace: Trace
    errors: dict[str, Array]
    notes: tuple[str, ...] = ()


def chart_reference(
    study: Study,
    episodes: Sequence[int],
    horizon: float | None,
    unit: str,
    most: int,
    *,
    progress: Callable[[float], None] | None = None,
) -> tuple[Distance, Reference]:
    """Reference of a chart, and the definition of errors, which includes the horizon.

    If `horizon` is None, errors are measured up to the time to which the reference of the median episode is converged. The horizon is
    shorter if all episodes diverge earlier.
    """
    law = {"contact": "mujoco"} if study.options.contact == "mujoco" else None
    distance = Distance(unit, horizon or study.seconds)
    reference = converge(study, episodes, distance, target=TARGET[unit], most=most, law=law, progress=progress)
    # Runs end where no episode is finite any more.
    reached = min(trace.reached for trace in (*reference.runs, *reference.second))
    if horizon is None or horizon > reached * (1 + 1e-9):
        known = float(np.median(reference.known)) if horizon is None else reached
        distance = Distance(unit, min(max(study.control_period, known), reached))
        reference = reference.with_distance(distance)
    return distance, with_trajectories(study, episodes, reference, distance)


def measure(
    basis: ChartBasis, all_lines: Sequence[Line], steps: Sequence[float], progress: Callable[[str, float], None]
) -> tuple[list[Point], list[str], dict[str, Reference]]:
    """Runs all lines of a chart with all lengths of the time step.

    Returns:
        Three results: the points of the chart; texts with the labels of lines that could not be run and the reasons; and by label of a
        line the converged run with the contact law of the line.
    """
    made: list[list[tuple[Trace, str]] | str] = []
    for line in all_lines:
        made.append(_runs(basis, line, steps))
        progress("runs", len(made) / len(all_lines))
    could = {number: own for number, own in enumerate(made) if not isinstance(own, str)}
    skipped = [f"{line.label}: {own}" for line, own in zip(all_lines, made, strict=True) if isinstance(own, str)]
    laws = _laws(basis, [all_lines[number] for number in could], lambda done: progress("laws of contact", done))
    distinct = {_solved_key(all_lines[n], dt): (all_lines[n], dt) for n in could for dt in steps if all_lines[n].engine == "stepper"}
    solved: dict[str, tuple[Trace, str]] = {}
    for key, (line, dt) in distinct.items():
        solved[key] = _run(basis, line.settings | TIGHT | {"timestep": dt}, until=basis.distance.horizon)
        progress("sources of errors", len(solved) / len(distinct))
    points = []
    for number, row in could.items():
        line = all_lines[number]
        for dt, (trace, note) in zip(steps, row, strict=True):
            tight = solved[_solved_key(line, dt)] if line.engine == "stepper" else (trace, note)
            points.append(_point(basis, (line, dt), (trace, note), tight, laws[_law(line)]))
    return points, skipped, {line.label: found for line in reversed(all_lines) if isinstance(found := laws.get(_law(line)), Reference)}


def _laws(basis: ChartBasis, lines: Sequence[Line], progress: Callable[[float], None]) -> dict[str, Reference | str]:
    """Converged run of each contact law in some lines of a chart, by its text from `_law`; without a run, the reason as text."""
    laws: dict[str, Reference | str] = {basis.study.options.contact: basis.reference}
    first = {_law(line): line for line in reversed(lines) if _law(line) not in laws}
    for done, (law, line) in enumerate(reversed(first.items())):
        laws[law] = _converged(basis, line)
        progress((done + 1) / len(first))
    return laws


def _law(line: Line) -> str:
    """Text that identifies the contact law of a line of the chart. Lines with equal texts share a converged run."""
    return line.law if line.engine == "stepper" else json.dumps(line.settings, sort_keys=True)


def _solved_key(line: Line, dt: float) -> str:
    """Text that identifies a line and a time step apart from solver settings; equal texts share the run with a tight tolerance."""
    return json.dumps({name: own for name, own in line.settings.items() if name not in TIGHT} | {"timestep": dt}, sort_keys=True)


def _runs(basis: ChartBasis, line: Line, steps: Sequence[float]) -> list[tuple[Trace, str]] | str:
    """Pairs of a run and a note, one per time step of a line of the chart; the reason as text if the line cannot be run."""
    try:
        return [_run(basis, line.settings | {"timestep": dt}) for dt in steps]
    except ValueError as error:
        return " ".join(str(error).split())[:300]


def _run(basis: ChartBasis, settings: dict[str, Any], until: float = math.inf) -> tuple[Trace, str]:
    """Run of a study with changed settings, and a note, which is empty unless the run was stopped."""
    study = basis.study
    patient = patience(study, basis.reference.trace, settings["timestep"], slower=_MAX_SLOWDOWN, least=_MIN_PATIENCE)
    trace = run(study, basis.episodes, until=until, patience=patient, **settings)
    if not trace.stopped:
        return trace, ""
    note = f"stopped after {trace.spent:.1f} s at {trace.reached:.3g} of {min(until, study.seconds):.3g} s"
    return trace, f"{note}: it takes more than {_MAX_SLOWDOWN:g} times as long as the converged run"


def _converged(basis: ChartBasis, line: Line) -> Reference | str:
    """Converged run for the contact law of a line of the chart, or the reason why it failed."""
    # All lines of hard contact share a run with one integrator. A line of MuJoCo's law runs with its integrator, because the study's
    # integrator may exist for hard contact only.
    law = None if line.law == "hard" else {name: own for name, own in line.settings.items() if name != "precision"}
    distance, most = basis.distance, min(basis.most, 5)
    try:
        return converge(basis.study, basis.episodes, distance, target=TARGET[distance.unit], most=most, law=law, until=distance.horizon)
    except ValueError as error:
        return " ".join(str(error).split())[:300]


def _point(basis: ChartBasis, at: tuple[Line, float], own: tuple[Trace, str], tight: tuple[Trace, str], law: Reference | str) -> Point:
    """Point of the chart from the runs of a line with a given time step."""
    nothing, (line, dt) = np.full(len(basis.episodes), np.nan), at
    trace, note = own
    notes = [note]
    if lost := int((~trace.finite).sum()):
        notes.append(f"not finite in {lost} of {len(trace.finite)} episodes")
    if tight[0] is not trace and tight[1]:
        notes.append(f"parts of solver and time step unknown, because the run with a tight tolerance did not succeed: {tight[1]}")
    if isinstance(law, str):
        notes.append(f"parts of time step and model unknown, because the run of its contact law did not converge: {law}")
    errors = {
        "total": basis.distance(trace, basis.reference.ground_truth),
        "solver": basis.distance(trace, tight[0]) if line.engine == "stepper" else nothing,
        "step": nothing if isinstance(law, str) else basis.distance(tight[0], law.trace),
        "model": nothing if isinstance(law, str) else basis.distance(law.trace, basis.reference.ground_truth),
    }
    return Point(line, dt, trace, errors, tuple(note for note in notes if note))
