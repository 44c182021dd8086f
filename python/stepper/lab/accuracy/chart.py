"""Chart of error against cost on the user's model, with errors split into parts due to the solver, the time step and the model.

Errors of single trajectories are meaningful up to the time at which the reference is converged. For longer times the chart also has errors
of invariants, and means of outcomes.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._arrays import array_of
from stepper.lab.accuracy.candidates import Line, lines, timesteps
from stepper.lab.accuracy.costs import BATCH, costs
from stepper.lab.accuracy.invariants import Invariants
from stepper.lab.accuracy.measure import CAUSES, TARGET, ChartBasis, Dot, Point, chart_reference, front, measure
from stepper.lab.accuracy.reference import Reference, check_moves
from stepper.lab.accuracy.traces import Distance, quantity
from stepper.lab.study.document import Document, Section, check_pages, counted
from stepper.lab.study.report import no_peer
from stepper.lab.study.study import Study
from stepper.shared.arguments import check_whole, path_of
from stepper.shared.files import locked, write_csv
from stepper.shared.machine import one_core, provenance
from stepper.shared.progress import ProgressCallback

Array = NDArray[np.float64]
_MEASURED = "Errors, and their part from the model, are distances from measured trajectories. The noise floor is the error of noise alone."


@dataclass(frozen=True)
class MeasuredTrajectories:
    """Trajectories of a real system, one for each episode of a study.

    Attributes:
        qpos: Measured positions at the ends of the control periods, (episodes, control periods, nq), m and rad. The position at the start
            of an episode is not among them. More episodes and periods than the study has are not used.
        noise: Standard deviation of the measured positions, a number or (nq,), m and rad.

    Raises:
        ValueError: An array of another shape, a number that is not finite, or a negative deviation.
    """

    qpos: Array
    noise: float | Array

    def __post_init__(self) -> None:
        qpos, noise = array_of("qpos of measured trajectories", self.qpos), array_of("noise of measured trajectories", self.noise)
        if qpos.ndim != 3:
            raise ValueError(f"qpos of measured trajectories has the shape {qpos.shape}, must be (episodes, control periods, nq)")
        if len(bad := np.argwhere(~np.isfinite(qpos))):
            episode, period, k = bad[0]
            raise ValueError(
                f"qpos of measured trajectories has a number that is not finite: episode {episode}, period {period}, qpos[{k}]"
            )
        if noise.shape not in ((), qpos.shape[2:]) or not (np.isfinite(noise) & (noise >= 0.0)).all():
            raise ValueError(f"noise of measured trajectories is {self.noise}, must be a finite number of at least 0, or one per qpos")

    def section(self, study: Study) -> Section:
        """Section of a report with the distances of a study's runs from the measured trajectories, split by cause, in m and in rad."""
        rows, numbers = [], range(study.episodes)
        own = Line("stepper", "the study's own", {}, study.options.contact)
        peers = [line for line in lines(study, quick=True) if line.engine != "stepper"]
        timestep = study.options.timestep or float(study.loaded[0].timestep)
        for unit in TARGET:
            basis = ChartBasis(study, numbers, *chart_reference(study, numbers, study.seconds, unit, 4), 4)
            for point in measure(basis, [own, *peers], [timestep], lambda _what, _done: None)[0]:
                parts = (*point.errors.values(), basis.reference.noise_floor)
                rows.append([point.line.label, unit, *(float(np.median(part)) for part in parts)])
        words = [f"Largest distances of bodies, geoms and sites, and largest angles of bodies; medians over episodes. {_MEASURED}"]
        head = ("settings", "unit", "error", *(f"from {word}" for word in CAUSES.values()), "noise floor")
        return Section("Errors from measured trajectories", words, head, rows)


@dataclass(frozen=True)
class Chart:
    """Result of `chart`.

    Attributes:
        study: The study.
        distance: Definition of errors: unit and horizon.
        reference: Converged run, relative to which errors are measured.
        dots: Points of the chart, ordered by settings, then time step.
        skipped: Settings that could not be run, with the reasons.
        document: The chart as a document.
        files: Files that were written.
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
    progress: ProgressCallback | None = None,
) -> Chart:
    """Charts error against cost for time steps, integrators, solvers, precisions, contact laws and MuJoCo.

    The reference is a run that is converged by halving the time step (`stepper.lab.accuracy.reference`). Sensors are ideal.

    Args:
        source: A study or its file; or a model, as for `stepper.load`, which gets random controls.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        horizon: Simulated time up to which errors are measured: "0.5 s", "500 ms", or a number of seconds. None selects the time up to
            which the reference of the median episode is converged to 0.1 mm (1 mrad).
        unit: Unit of errors: "m" for differences in position of bodies, geoms and sites, "rad" for differences in orientation of bodies.
        episodes: Number of episodes; the chart shows their medians.
        quick: Whether to use fewer settings, time steps and repeats.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The chart. OUT/NAME has chart.html, chart.md, chart.png, chart.csv.

    Raises:
        ValueError: The model has no joints, or the horizon is longer than an episode.
        BlockingIOError: Another run writes to OUT/NAME.
    """
    check_pages()
    study = replace(check_moves(Study.from_model(source)), threads=1)
    check_whole("episodes", episodes, least=1)
    if unit not in list(TARGET):
        raise ValueError(f'unit is {unit!r}, must be "m" or "rad"')
    until = None if horizon is None else quantity(horizon, name="horizon", units=("s",))[0]
    if until is not None and not study.control_period <= until <= study.seconds * (1 + 1e-9):
        raise ValueError(
            f"horizon is {until:g} s, must be between a control period, {study.control_period:g} s, and an episode, {study.seconds:g} s"
        )
    with locked(path_of("out", out) / study.name) as folder:
        report_progress: ProgressCallback = progress or (lambda _what, _done: None)
        numbers, most = range(episodes), 4 if quick else 7
        distance, reference = chart_reference(study, numbers, until, unit, most, progress=lambda done: report_progress("reference", done))
        basis = ChartBasis(study, numbers, distance, reference, most)
        steps = timesteps(study, coarser=2 if quick else 3, finer=1 if quick else 3)
        points, skipped, laws = measure(basis, lines(study, quick=quick), steps, report_progress)
        skipped = [f"MuJoCo: {reason}" for reason in [no_peer(study)] if reason] + skipped
        invariants = Invariants(study)
        dots = _dots(basis, points, invariants, quick=quick, report_progress=report_progress)
        found = Chart(study, distance, reference, dots, tuple(skipped), Document(f"Error against cost: {study.name}"), ())
        return replace(found, files=tuple(_write(found, laws, invariants, folder)))


def _dots(
    basis: ChartBasis, points: Sequence[Point], invariants: Invariants, *, quick: bool, report_progress: ProgressCallback
) -> tuple[Dot, ...]:
    """Errors, costs and outcomes of all points of a chart as numbers. Costs and errors of invariants are measured here."""
    study, kept = basis.study, list[dict[str, Array]]()
    for point in points:
        errors = invariants.measure(point.trace)
        kept.append({kind.label: errors[kind] for kind in invariants.kinds})
        report_progress("invariants", len(kept) / len(points))
    # Diverged runs are not timed: steps that cannot be solved use all their iterations.
    timed = [k for k, point in enumerate(points) if math.isfinite(float(np.median(point.errors["total"])))]
    with one_core():
        spent = costs(
            study,
            [points[k].line.settings | {"timestep": points[k].timestep} for k in timed],
            [points[k].trace for k in timed],
            repeats=3 if quick else 7,
            seconds=0.004 if quick else 0.02,
            progress=lambda done: report_progress("costs", done),
        )
    by_point = dict(zip(timed, spent, strict=True))
    return tuple(_dot(basis, point, by_point.get(k, (math.nan, math.nan)), kept[k]) for k, point in enumerate(points))


def _dot(basis: ChartBasis, point: Point, cost: tuple[float, float], kept: dict[str, Array]) -> Dot:
    """Errors, costs and outcomes of one point of a chart (a run of some settings with a given time step), as numbers.

    `cost` has microseconds of one core for a simulated second, alone and in a batch; NaN if not measured. `kept` has errors of invariants
    by name, (episodes,) each.
    """
    study, trace = basis.study, point.trace
    outcome = study.success_outcome or next(iter(study.all_outcomes), None)
    values = np.full(1, math.nan) if outcome is None or trace.stopped else trace.outcomes[outcome.name]
    whole = outcome is not None and outcome.success is not None and not trace.stopped
    middle = {name: float(np.median(own)) for name, own in point.errors.items()}
    return Dot(
        engine=point.line.engine,
        setting=point.line.name,
        timestep=point.timestep,
        error=middle["total"],
        min_error=float(point.errors["total"].min()),
        max_error=float(point.errors["total"].max()),
        solver=middle["solver"],
        step=middle["step"],
        model=middle["model"],
        noise_floor=float(np.median(basis.reference.noise_floor)),
        us_single_env=cost[0],
        batch=cost[1],
        depth=float(trace.depth.max()),
        residual=float(trace.residual.max()),
        outcome=_mean(values),
        share=float(outcome.succeeds(values).mean()) if whole and outcome is not None else math.nan,
        invariants={name: _largest(own) for name, own in kept.items()},
        notes=point.notes,
    )


def _mean(values: Array) -> float:
    """Mean of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan


def _largest(values: Array) -> float:
    """Largest of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else math.nan


def _write(found: Chart, laws: Mapping[str, Reference], invariants: Invariants, folder: Path) -> list[Path]:
    """Writes the files of a chart, chart.png, .csv, .html and .md, and returns their paths.

    `laws` has the converged run with the contact law of each line of the chart, by label of the line.
    """
    from stepper.lab.accuracy.draw import draw  # noqa: PLC0415  (matplotlib is optional, and slow to import)

    study, distance, reference, came_from = found.study, found.distance, found.reference, provenance()
    note = f"{came_from['cpu']}, one core, {came_from['utc']}"
    picture = draw(study, distance, reference, found.dots, path=folder / "chart.png", note=note)
    table = folder / "chart.csv"
    header = {"reference": reference.words, "horizon_s": distance.horizon, "unit": distance.unit}
    header |= study.resolved_settings() | came_from
    notes = [f"# {key}: {value if isinstance(value, str) else json.dumps(value, default=str)}\n" for key, value in header.items()]
    columns = list(dict.fromkeys(name for dot in found.dots for name in dot.row))
    write_csv(table, [columns, *([dot.row.get(name, "") for name in columns] for dot in found.dots)], "".join(notes))
    found.document.sections += _sections(found, laws, invariants, picture)
    return [picture, table, *found.document.save(folder, "chart")]


def _sections(found: Chart, laws: Mapping[str, Reference], invariants: Invariants, picture: Path) -> list[Section]:
    """Sections of the document of a chart."""
    dots, study, unit = found.dots, found.study, found.distance.unit
    best = set(map(id, [*front(dots, "us_single_env"), *front(dots, "batch")]))
    parts = [*(f"from {word}" for word in CAUSES.values()), *(["noise floor"] if study.trajectories else [])]
    head = ("", "settings", "time step, ms", f"error, {unit}", *parts, "cause", "alone, us", "batch, us", "penetration, mm")
    outcome = study.success_outcome or next(iter(study.all_outcomes), None)
    more = ("residual, m/s", *(() if outcome is None else (f"mean {outcome.name}", "successes")), "notes")

    def row(dot: Dot) -> list[Any]:
        parts = (dot.solver, dot.step, dot.model, *([dot.noise_floor] if study.trajectories else []))
        numbers = (dot.error, *parts, dot.cause, dot.us_single_env, dot.batch, 1e3 * dot.depth, dot.residual)
        outcomes = () if outcome is None else (dot.outcome, dot.share)
        return ["*" if id(dot) in best else "", dot.label, 1e3 * dot.timestep, *numbers, *outcomes, "; ".join(dot.notes)]

    fronts = [dot for dot in dots if id(dot) in best]
    return [
        Section("Error against cost", _words(found, laws), picture=picture),
        Section(
            "Pareto fronts",
            ["Points to which no other is both cheaper, alone or in a batch, and more accurate."],
            (*head, *more),
            list(map(row, fronts)),
        ),
        Section("All points", [], (*head, *more), list(map(row, dots))),
        _invariants(found, invariants),
    ]


def _words(found: Chart, laws: Mapping[str, Reference]) -> list[str]:
    """Paragraphs for the document that accompanies a chart. They explain its errors, costs and reference solution."""
    reference, unit, horizon = found.reference, found.distance.unit, found.distance.horizon
    what = "largest distance of a body, geom or site" if unit == "m" else "largest angle of a body"
    others = [f"{label} {np.median(law.uncertainty):.1e}" for label, law in laws.items() if law is not reference]
    stopped = sum(bool(dot.notes) for dot in found.dots)
    words = [
        f"Errors are the {what} from the reference up to {horizon:.3g} s, in {unit}, medians over "
        f"{counted(len(reference.uncertainty), 'episode')}. Reference: {reference.words}."
        f" Its last two runs agree to {TARGET[unit]:g} {unit} up to {np.median(reference.known):.3g} s (median; at least "
        f"{reference.known.min():.3g} s). After this time, compare invariants and outcomes instead of single motions.",
        f"Costs are processor time of one core: microseconds for a simulated second of one environment, alone and of {BATCH} in a "
        "batch, with recorded controls. MuJoCo steps one environment after the other in both.",
        "An error has three causes, each with its part. solver: distance from the same run solved to 1e-9 m/s in 64 bits. time step: "
        "distance of that run from the converged run with its law of contact. model: distance of that converged run from the reference "
        "(softness, friction cone). The column cause has the one with the largest part; docs/reference/studies.md has remedies. "
        "The reference has hard contact, unless the study's options have MuJoCo's law."
        + (f" {_MEASURED}" if found.study.trajectories else "")
        + (f" Uncertainty of the converged runs, {unit} (median): {'; '.join(others)}." if others else ""),
    ]
    if stopped:
        words.append(f"{stopped} of {len(found.dots)} rows have a note on what was stopped or not finite.")
    return [*words, *(f"Not run: {reason}." for reason in found.skipped)]


def _invariants(found: Chart, invariants: Invariants) -> Section:
    """Section of a chart's document with the errors of invariants, such as energy: quantities that every correct motion conserves."""
    kinds, left = [kind.label for kind in invariants.kinds], invariants.left_out
    words = [
        "Errors of laws that every correct motion satisfies, also a chaotic one: the largest of all episodes, after every control period, "
        "computed from positions and velocities in the same way for all engines. docs/reference/studies.md has the definitions."
        if kinds
        else "The scene has none."
    ]
    words += [f"Left out: {reason}." for reason in left]
    rows = [[dot.label, 1e3 * dot.timestep, *dot.invariants.values(), "; ".join(dot.notes)] for dot in found.dots] if kinds else []
    return Section("Invariants", words, ("settings", "time step, ms", *kinds, "notes"), rows)
