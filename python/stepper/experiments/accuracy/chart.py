"""Error against cost on the user's own model, with errors split into what the solver, the time step and the model make of them."""

from __future__ import annotations

import csv
import functools
import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.experiments.accuracy.candidates import Line, lines, pareto, timesteps
from stepper.experiments.accuracy.costs import BATCH, costs
from stepper.experiments.accuracy.reference import TIGHT, Reference, check_moves, converge
from stepper.experiments.accuracy.traces import Distance, Trace, quantity, run
from stepper.experiments.progress import Tick
from stepper.experiments.study.document import Document, Section
from stepper.experiments.study.over_ray import each
from stepper.experiments.study.report import no_peer
from stepper.experiments.study.study import Study
from stepper.shared.machine import one_core, provenance

Array = NDArray[np.float64]
_TARGET = {"m": 1e-4, "rad": 1e-3}
"""Uncertainty to which a reference is converged, and up to which time it is known where no horizon is given."""


@dataclass(frozen=True)
class Dot:
    """Settings at one time step: a point of a chart. Errors are medians over episodes, in the unit of the distance.

    Attributes:
        engine: "stepper" or "MuJoCo".
        setting: In a few words.
        timestep: s.
        error: From the reference; infinite where a run is not finite.
        least: Of all episodes.
        most: Of all episodes.
        solver: From the same run solved to 1e-11 m/s in 64 bits; NaN in MuJoCo.
        step: Of that run from the converged one of the same law.
        model: Of that from the reference: softness, and the friction cone.
        alone: Microseconds of one core for a simulated second of one environment, stepped alone.
        batch: The same in a batch.
        depth: Deepest overlap of all episodes, m.
        residual: Largest residual of all episodes, m/s; NaN in MuJoCo.
        outcome: Mean of the outcome that decides, or the first; NaN without one.
        share: Share of successes; NaN without one.
    """

    engine: str
    setting: str
    timestep: float
    error: float
    least: float
    most: float
    solver: float
    step: float
    model: float
    alone: float
    batch: float
    depth: float
    residual: float
    outcome: float
    share: float

    @property
    def label(self) -> str:
        """Engine and settings."""
        return f"{self.engine}: {self.setting}"


@dataclass(frozen=True)
class Chart:
    """What a chart shows.

    Attributes:
        study: What was run.
        distance: What errors are.
        reference: What is right.
        dots: By line, then time step.
        skipped: What could not be run, with the reason.
        document: In words.
        files: What was written.
    """

    study: Study
    distance: Distance
    reference: Reference
    dots: tuple[Dot, ...]
    skipped: tuple[str, ...]
    document: Document
    files: tuple[Path, ...]

    def __str__(self) -> str:
        return self.document.markdown()


def chart(
    source: Any,
    out: str | os.PathLike[str] = "out",
    *,
    horizon: str | float | None = None,
    unit: str = "m",
    episodes: int = 8,
    quick: bool = False,
    tick: Tick | None = None,
) -> Chart:
    """Error against cost for time steps, integrators, solvers, precisions, laws of contact and MuJoCo's settings, on a model of one's own.

    The reference is converged by halving the time step (`stepper.experiments.accuracy.reference`). Sensors are ideal. Of a study over Ray,
    settings are run as tasks, and costs are measured here.

    Args:
        source: A study or the file of one; or a model as of `stepper.load`, which gets random controls.
        out: The folder that has a folder for every study.
        horizon: Time up to which errors count: "0.5 s", "500 ms", or a number of seconds, as of `tune`; None is as far as the median
            episode is known to 0.1 mm (1 mrad).
        unit: "m" for the largest distance of a body, geom or site, "rad" for the largest angle of a body.
        episodes: How many, medians of which count.
        quick: Fewer settings, time steps and repeats.
        tick: Progress.

    Returns:
        Points, and what was written: OUT/NAME/chart.html, .md, .png, .csv.

    Raises:
        ValueError: A model without joints, a horizon that is not within the episodes.
    """
    study = replace(check_moves(Study.of(source)), threads=1)
    if unit not in _TARGET:
        raise ValueError(f'unit is {unit!r}, must be "m" or "rad"')
    seconds = None if horizon is None else quantity(horizon, name="horizon", units=("s",))[0]
    if seconds is not None and not study.hold <= seconds <= study.seconds * (1 + 1e-9):
        raise ValueError(f"horizon is {seconds:g} s, must be between a control, {study.hold:g} s, and an episode, {study.seconds:g} s")
    told: Tick = tick or (lambda _what, _done: None)
    numbers, most = range(episodes), 4 if quick else 7
    distance, right = _reference(study, numbers, seconds, unit, most, tick=lambda done: told("reference", done))
    ground = _Ground(study, numbers, distance, right, most)
    steps = timesteps(study, coarser=2 if quick else 3, finer=1 if quick else 3)
    measured, skipped = _measure(ground, lines(study, quick=quick), steps, lambda done: told("errors", done))
    with one_core():
        spent = costs(
            study,
            [point.line.settings | {"timestep": point.timestep} for point in measured],
            [point.trace for point in measured],
            repeats=3 if quick else 7,
            seconds=0.004 if quick else 0.02,
            tick=lambda done: told("costs", done),
        )
    dots = tuple(_dot(study, point, cost) for point, cost in zip(measured, spent, strict=True))
    folder = Path(out) / study.name
    folder.mkdir(parents=True, exist_ok=True)
    document, files = _write(ground, dots, skipped, folder)
    return Chart(study, distance, right, dots, tuple(skipped), document, tuple(files))


@dataclass(frozen=True)
class _Ground:
    """What all points of a chart are measured against."""

    study: Study
    episodes: Sequence[int]
    distance: Distance
    right: Reference
    most: int


@dataclass(frozen=True)
class _Point:
    """What a line did at a time step, with its errors by name, (episodes,)."""

    line: Line
    timestep: float
    trace: Trace
    errors: dict[str, Array]


def _reference(
    study: Study, episodes: Sequence[int], horizon: float | None, unit: str, most: int, *, tick: Callable[[float], None]
) -> tuple[Distance, Reference]:
    """What is right, and how far."""
    law = {"contact": "mujoco"} if study.options.contact == "mujoco" else None
    distance = Distance(unit, horizon or study.seconds)
    right = converge(study, episodes, distance, target=_TARGET[unit], most=most, law=law, tick=tick)
    if horizon is None:
        known = float(np.median(right.known))
        distance = Distance(unit, max(study.hold, known))
        right = right.judged(distance)
    return distance, right


def _measure(
    ground: _Ground, all_lines: Sequence[Line], steps: Sequence[float], tick: Callable[[float], None]
) -> tuple[list[_Point], list[str]]:
    """Runs of all lines at all time steps, with their errors; and what could not be run."""
    study = ground.study
    laws: dict[str, Trace | str] = {study.options.contact: ground.right.trace}
    first = {_law(line): line for line in reversed(all_lines) if _law(line) not in laws}
    for number, law in each(study, list(first.values()), functools.partial(_converged, ground)):
        laws[list(first)[number]] = law
    made: dict[int, list[_Point] | str] = {}
    for number, points in each(study, [(line, laws[_law(line)]) for line in all_lines], functools.partial(_points, ground, steps)):
        made[number] = points
        tick(len(made) / len(all_lines))
    measured: list[_Point] = []
    reason = no_peer(study)
    skipped = [f"MuJoCo: {reason}"] if reason else []
    for number, line in enumerate(all_lines):
        points = made[number]
        if isinstance(points, str):
            skipped.append(f"{line.label}: {points}")
        else:
            measured += points
    return measured, skipped


def _law(line: Line) -> str:
    """What lines share that have one converged run."""
    return line.law if line.engine == "stepper" else json.dumps(line.settings, sort_keys=True)


def _converged(ground: _Ground, study: Study, line: Line) -> Trace | str:
    """The converged run of a line's law, or why there is none."""
    # Hard contact is converged by one rule for all lines; MuJoCo's law by that of the line, as the study's own may be of hard contact.
    law = None if line.law == "hard" else {name: own for name, own in line.settings.items() if name != "precision"}
    target = _TARGET[ground.distance.unit]
    try:
        return converge(study, ground.episodes, ground.distance, target=target, most=min(ground.most, 5), law=law).trace
    except ValueError as error:
        return _reason(error)


def _points(ground: _Ground, steps: Sequence[float], study: Study, own: tuple[Line, Trace | str]) -> list[_Point] | str:
    """A line at all time steps, or why it could not be run."""
    line, converged = own
    if isinstance(converged, str):
        return converged
    try:
        return [_errors(ground, study, line, dt, converged) for dt in steps]
    except ValueError as error:
        return _reason(error)


def _reason(error: ValueError) -> str:
    return " ".join(str(error).split())[:300]


def _errors(ground: _Ground, study: Study, line: Line, dt: float, converged: Trace) -> _Point:
    episodes, distance, right = ground.episodes, ground.distance, ground.right
    settings = line.settings | {"timestep": dt}
    trace = run(study, episodes, **settings)
    tight = run(study, episodes, **(settings | TIGHT)) if line.engine == "stepper" else trace
    errors = {
        "total": distance(trace, right.trace),
        "solver": distance(trace, tight) if line.engine == "stepper" else np.full(len(episodes), np.nan),
        "step": distance(tight, converged),
        "model": distance(converged, right.trace),
    }
    return _Point(line, dt, trace, errors)


def _dot(study: Study, point: _Point, cost: tuple[float, float]) -> Dot:
    outcome, trace = study.decisive or next(iter(study.all_outcomes), None), point.trace
    values = np.full(1, np.nan) if outcome is None else trace.outcomes[outcome.name]
    share = math.nan if outcome is None or outcome.success is None else float(outcome.succeeds(values).mean())
    middle = {name: float(np.median(own)) for name, own in point.errors.items()}
    return Dot(
        engine=point.line.engine,
        setting=point.line.name,
        timestep=point.timestep,
        error=middle["total"],
        least=float(point.errors["total"].min()),
        most=float(point.errors["total"].max()),
        solver=middle["solver"],
        step=middle["step"],
        model=middle["model"],
        alone=cost[0],
        batch=cost[1],
        depth=float(trace.depth.max()),
        residual=float(trace.residual.max()),
        outcome=float(values.mean()),
        share=share,
    )


def front(dots: Sequence[Dot], cost: str, engine: str | None = None) -> list[Dot]:
    """Points that nothing is both cheaper and more accurate than, by cost ("alone" or "batch")."""
    own = [dot for dot in dots if math.isfinite(dot.error) and engine in (None, dot.engine)]
    return [own[k] for k in pareto([getattr(dot, cost) for dot in own], [dot.error for dot in own])]


def _write(ground: _Ground, dots: Sequence[Dot], skipped: Sequence[str], folder: Path) -> tuple[Document, list[Path]]:
    from stepper.experiments.accuracy.draw import draw  # noqa: PLC0415  (matplotlib is optional, and slow to import)

    study, distance, right, came_from = ground.study, ground.distance, ground.right, provenance()
    note = f"{came_from['cpu']}, one core, {came_from['utc']}"
    picture = draw(study, distance, right, dots, path=folder / "chart.png", note=note)
    table = folder / "chart.csv"
    with table.open("w", newline="", encoding="utf-8") as file:
        for key, value in {
            "reference": right.words,
            "horizon_s": distance.horizon,
            "unit": distance.unit,
            **study.in_force,
            **came_from,
        }.items():
            file.write(f"# {key}: {value if isinstance(value, str) else json.dumps(value, default=str)}\n")
        writer = csv.DictWriter(file, list(asdict(dots[0])))
        writer.writeheader()
        writer.writerows(asdict(dot) for dot in dots)
    document = Document(f"Error against cost: {study.name}", _sections(ground, dots, skipped, picture))
    return document, [picture, table, *document.save(folder, "chart")]


def _sections(ground: _Ground, dots: Sequence[Dot], skipped: Sequence[str], picture: Path) -> list[Section]:
    study, right, unit, horizon = ground.study, ground.right, ground.distance.unit, ground.distance.horizon
    what = "largest distance of a body, geom or site" if unit == "m" else "largest angle of a body"
    words = [
        f"Errors are the {what} from the reference up to {horizon:.3g} s, in {unit}, medians over {len(right.uncertainty)} episodes. "
        f"Reference: {right.words}. Up to {np.median(right.known):.3g} s (median; {right.known.min():.3g} s at least) its last two runs "
        f"are one to {_TARGET[unit]:g} {unit}; later no single motion is right, and outcomes are what can be compared.",
        f"Costs are processor time of one core: microseconds for a simulated second of one environment, alone and of {BATCH} in a "
        "batch, with recorded controls. MuJoCo steps one environment after the other in both.",
        "solver: what the solver left and rounding, from the same run solved to 1e-11 m/s in 64 bits. step: that run from the "
        "converged one of its law of contact. model: that one from the reference (softness, friction cone): hard contact is what is "
        "right here, unless the study's options have MuJoCo's law.",
        *(f"Not run: {reason}." for reason in skipped),
    ]
    head = (
        "",
        "settings",
        "time step, ms",
        f"error, {unit}",
        "solver",
        "step",
        "model",
        "alone, us",
        "batch, us",
        "depth, mm",
        "residual, m/s",
    )
    best = set(map(id, [*front(dots, "alone"), *front(dots, "batch")]))
    outcome = study.decisive or next(iter(study.all_outcomes), None)
    more = () if outcome is None else (f"mean {outcome.name}", "successes")

    def row(dot: Dot) -> list[Any]:
        numbers = (dot.error, dot.solver, dot.step, dot.model, dot.alone, dot.batch, 1e3 * dot.depth, dot.residual)
        return [
            "*" if id(dot) in best else "",
            dot.label,
            1e3 * dot.timestep,
            *numbers,
            *([] if outcome is None else [dot.outcome, dot.share]),
        ]

    fronts = [dot for dot in dots if id(dot) in best]
    return [
        Section("What it shows", words, picture=picture),
        Section(
            "Pareto fronts", ["Nothing else is cheaper, alone or in a batch, and more accurate."], (*head, *more), list(map(row, fronts))
        ),
        Section("All points", [], (*head, *more), [row(dot) for dot in dots]),
    ]
