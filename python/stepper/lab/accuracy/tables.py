"""Output files of a chart: document and table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepper.lab.accuracy.costs import BATCH
from stepper.lab.accuracy.invariants import Invariants
from stepper.lab.accuracy.measure import CAUSES, TARGET, ChartBasis, Dot, Point, front
from stepper.lab.accuracy.reference import Reference
from stepper.lab.study.document import Document, Section, counted
from stepper.shared.files import write_csv
from stepper.shared.machine import provenance


@dataclass(frozen=True)
class ChartData:
    """Data of a chart for its output files.

    Attributes:
        basis: Data that all points of the chart share.
        points: Runs of all settings with all lengths of the time step.
        dots: The same points as numbers (errors, costs, outcomes), in the same order.
        skipped: Settings that could not be run, with the reasons.
        laws: Converged run with the contact law of each line of the chart, by label of the line.
        invariants: Invariants of the scene.
    """

    basis: ChartBasis
    points: Sequence[Point]
    dots: Sequence[Dot]
    skipped: Sequence[str]
    laws: Mapping[str, Reference]
    invariants: Invariants


def write(found: ChartData, folder: Path) -> tuple[Document, list[Path]]:
    """Writes the files of a chart: chart.png, .csv, .html and .md.

    Returns:
        The document, and the paths of all files.
    """
    from stepper.lab.accuracy.draw import draw  # noqa: PLC0415  (matplotlib is optional, and slow to import)

    basis, came_from = found.basis, provenance()
    study, distance, reference = basis.study, basis.distance, basis.reference
    note = f"{came_from['cpu']}, one core, {came_from['utc']}"
    picture = draw(study, distance, reference, found.dots, path=folder / "chart.png", note=note)
    table = folder / "chart.csv"
    header = {"reference": reference.words, "horizon_s": distance.horizon, "unit": distance.unit}
    header |= study.resolved_settings() | came_from
    notes = [f"# {key}: {value if isinstance(value, str) else json.dumps(value, default=str)}\n" for key, value in header.items()]
    columns = list(dict.fromkeys(name for dot in found.dots for name in dot.row))
    write_csv(table, [columns, *([dot.row.get(name, "") for name in columns] for dot in found.dots)], "".join(notes))
    document = Document(f"Error against cost: {study.name}", _sections(found, picture))
    return document, [picture, table, *document.save(folder, "chart")]


def _sections(found: ChartData, picture: Path) -> list[Section]:
    """Sections of the document of a chart."""
    dots, basis = found.dots, found.basis
    best = set(map(id, [*front(dots, "us_single_env"), *front(dots, "batch")]))
    study, unit = basis.study, basis.distance.unit
    parts = [f"from {word}" for word in CAUSES.values()]
    head = ("", "settings", "time step, ms", f"error, {unit}", *parts, "cause", "alone, us", "batch, us", "penetration, mm")
    outcome = study.success_outcome or next(iter(study.all_outcomes), None)
    more = ("residual, m/s", *(() if outcome is None else (f"mean {outcome.name}", "successes")), "notes")

    def row(dot: Dot) -> list[Any]:
        numbers = (dot.error, dot.solver, dot.step, dot.model, dot.cause, dot.us_single_env, dot.batch, 1e3 * dot.depth, dot.residual)
        outcomes = () if outcome is None else (dot.outcome, dot.share)
        return ["*" if id(dot) in best else "", dot.label, 1e3 * dot.timestep, *numbers, *outcomes, "; ".join(dot.notes)]

    fronts = [dot for dot in dots if id(dot) in best]
    return [
        Section("Error against cost", _words(found), picture=picture),
        Section(
            "Pareto fronts",
            ["Points to which no other is both cheaper, alone or in a batch, and more accurate."],
            (*head, *more),
            list(map(row, fronts)),
        ),
        Section("All points", [], (*head, *more), list(map(row, dots))),
        _invariants(found),
    ]


def _words(found: ChartData) -> list[str]:
    """Paragraphs for the document that accompanies a chart. They explain its errors, costs and reference solution."""
    basis = found.basis
    reference, unit, horizon = basis.reference, basis.distance.unit, basis.distance.horizon
    what = "largest distance of a body, geom or site" if unit == "m" else "largest angle of a body"
    laws = [f"{label} {np.median(law.uncertainty):.1e}" for label, law in found.laws.items() if law is not reference]
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
        + (f" Uncertainty of the converged runs, {unit} (median): {'; '.join(laws)}." if laws else ""),
    ]
    if stopped:
        words.append(f"{stopped} of {len(found.dots)} rows have a note on what was stopped or not finite.")
    return [*words, *(f"Not run: {reason}." for reason in found.skipped)]


def _invariants(found: ChartData) -> Section:
    """Section of a chart's document with the errors of invariants, such as energy: quantities that every correct motion conserves."""
    kinds, left = [kind.label for kind in found.invariants.kinds], found.invariants.left_out
    words = [
        "Errors of laws that every correct motion satisfies, also a chaotic one: the largest of all episodes, after every control period, "
        "computed from positions and velocities in the same way for all engines. docs/reference/studies.md has the definitions."
        if kinds
        else "The scene has none."
    ]
    words += [f"Left out: {reason}." for reason in left]
    rows = [[dot.label, 1e3 * dot.timestep, *dot.invariants.values(), "; ".join(dot.notes)] for dot in found.dots] if kinds else []
    return Section("Invariants", words, ("settings", "time step, ms", *kinds, "notes"), rows)
