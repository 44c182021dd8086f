"""Ranking of a study's parameters (`stepper.lab.rank`): global sensitivity of an outcome, as Sobol indices with confidence intervals.

All parameters are drawn from their ranges at once. The total index of a parameter is the fraction of the outcome's variance that remains
when all others are known. The first-order index is the fraction that the parameter explains alone; the difference is due to interactions.
Both are estimated with Saltelli's design: matrices of points A and B, and for each parameter the matrix A with the column of that
parameter taken from B.

A. Saltelli et al., "Variance based sensitivity analysis of model output", Computer Physics Communications 181 (2010) 259-270.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.batches import USUAL, Point, inapplicable, nominal_of, run_points
from stepper.lab.study.document import Document, Section, counted
from stepper.lab.study.intervals import wilson
from stepper.lab.study.journal import Results, Table, diverged
from stepper.lab.study.parameters import check_value_conflicts, selected
from stepper.lab.study.report import settings_sections, study_of
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import main_values, measured
from stepper.shared.arguments import check_whole
from stepper.shared.files import write_figure
from stepper.shared.machine import package_version, require
from stepper.shared.progress import ProgressCallback

Array = NDArray[np.float64]
_THIRDS = 3
"""Number of equal parts of a parameter's range in which mean outcomes are computed."""
_RESAMPLES = 499
"""Number of bootstrap samples for the confidence intervals of Sobol indices."""


@dataclass(frozen=True)
class Rank:
    """Influence of a parameter on the outcome.

    Attributes:
        parameter: Name of the parameter.
        total: Total Sobol index: fraction of the outcome's variance that remains when all other parameters are known.
        total_interval: 95 % interval of `total`, by bootstrap over the points. With 64 samples of a rare success, the interval
            contains the true index in 89 to 93 % of cases.
        first: First-order Sobol index: fraction of the variance that the parameter explains alone. Estimates of small indices may be
            negative.
        first_interval: 95 % interval of `first`.
        thirds: Fraction of successes (or mean outcome) in the lowest, middle and highest third of the parameter's range.
        intervals: 95 % intervals of `thirds`: Wilson's for fractions, two standard errors for means.
    """

    parameter: str
    total: float
    total_interval: tuple[float, float]
    first: float
    first_interval: tuple[float, float]
    thirds: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Ranking:
    """Result of `rank`.

    Attributes:
        study: The study.
        setting: Name of the settings.
        ranks: Influence of each parameter, the largest total index first.
        outcome: Fraction of successes (or mean outcome) over the independent points, those of the matrices A and B of Saltelli's design.
        interval: 95 % interval of `outcome`.
        table: Table of all episodes.
        document: The ranking as a document.
        files: Files that were written.
    """

    study: Study
    setting: str
    ranks: tuple[Rank, ...]
    outcome: float
    interval: tuple[float, float]
    table: Table
    document: Document
    files: tuple[Path, ...]

    def __str__(self) -> str:
        return self.document.markdown()


def rank(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str] = "out",
    *,
    samples: int = 64,
    parameters: Sequence[str] | None = None,
    setting: str = USUAL,
    progress: ProgressCallback | None = None,
) -> Ranking:
    """Ranks the parameters of a study by their influence on the outcome, with Sobol indices.

    All parameters are drawn from their ranges at once. The outcome is success (1 or 0) if the study has a condition of success, otherwise
    the measured number. It is averaged over the episodes of a point. Finished episodes are kept on disk and not repeated.

    Args:
        study: A study, or its file.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        samples: Number of base samples, a power of 2. The number of points is samples times (2 + number of parameters).
        parameters: Names, or selectors with a range, such as "geom_friction[floor][0]=0.2..1"; None selects all parameters with low
            and high.
        setting: Name of the settings.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The ranking. OUT/NAME has rank.html, rank.md, rank.png, rank_table.csv, rank_table.npz.

    Raises:
        ValueError: The study has no outcome, or fewer than two parameters with a range. A parameter has no effect with the settings, or is
            an option of the step. Two parameters set the same number. `samples` is not a power of 2. The outcome is not finite, or the
            same at every point.
        MissingPackageError: SciPy is not installed.
    """
    study, names = varied(study_of(study), parameters, setting, 2)
    check_whole("samples", samples)
    if samples < 2 or samples & (samples - 1):
        raise ValueError(f"samples is {samples}, must be a power of 2, and at least 2")
    # SciPy is imported before the long run, so that its absence is reported at once.
    stats = require("scipy.stats", "to rank parameters")
    first, second, mixed = _design(stats, study, names, samples)
    nominal, designed = nominal_of(study, setting), np.concatenate([first, second, *mixed]).tolist()
    points = [Point(nominal | dict(zip(names, row, strict=True)), setting) for row in designed]
    with Results(study, out) as results:
        rows = run_points(study, points, results.journal, None if progress is None else lambda done: progress(f"rank {study.name}", done))
        values = _values(study, rows)
        n = samples
        independent = values[: 2 * n]
        if np.ptp(independent) == 0.0:
            raise ValueError(
                f"the outcome is the same at all {2 * n} independent points and differs at others, so that its variance is unknown; "
                f"give more samples than {n}"
            )
        total, first_order, total_ends, first_ends = _indices(stats, study, values, n)
        ranks = []
        for k, name in enumerate(names):
            column = np.concatenate([first[:, k], second[:, k]])
            thirds, intervals = _thirds(study, independent, column)
            ends = [(float(low), float(high)) for low, high in (total_ends[k], first_ends[k])]
            if study.success_outcome is not None:
                # If outcomes are equal in all n pairs of points, the bootstrap gives an interval of length 0. The upper end is therefore at
                # least the index that follows from Wilson's bound of the fraction of pairs that differ, with changes from 0 to 1.
                bound = min(1.0, wilson(0, n)[1] / (2.0 * float(independent.var())))
                ends = [(0.0, bound)] * 2 if total[k] == 0.0 else [(low, max(high, bound)) for low, high in ends]
            ranks.append(Rank(name, float(total[k]), ends[0], float(first_order[k]), ends[1], thirds, intervals))
        ranks.sort(key=lambda entry: -entry.total)
        document, table = Document(f"Ranking of {study.name}"), Table(rows)
        ranking = Ranking(study, setting, tuple(ranks), *_average(study, independent), table, document, ())
        picture = _draw(ranking, results.folder / "rank.png") if package_version("matplotlib") else None
        document.sections += [*_sections(ranking, samples, picture), *settings_sections(study, len(table), "rank_table")]
        files = [*table.save(results.folder, "rank_table"), *document.save(results.folder, "rank"), *([picture] if picture else [])]
    return Ranking(study, setting, tuple(ranks), ranking.outcome, ranking.interval, table, document, tuple(files))


def varied(study: Study, chosen: Sequence[str] | None, setting: str, least: int) -> tuple[Study, list[str]]:
    """Study with the chosen parameters, names or selectors with a range, and their names; None chooses all that have low and high.

    There must be an outcome, and at least this number of parameters.
    """
    if not study.all_outcomes:
        raise ValueError("the study has no outcome, so there is nothing to rank or to fit by; give it one")
    study.setting(setting)
    if chosen is not None:
        added = selected(study.parameters, chosen, study.loaded[0])
        study, chosen = replace(study, parameters={**study.parameters, **added}), list(added)
    ranged = [name for name, p in study.parameters.items() if p.low is not None and p.high is not None and p.kind != "options"]
    names = ranged if chosen is None else list(chosen)
    for name in names:
        if name not in ranged:
            raise ValueError(
                f"parameter {name!r} has no low and high, or is an option of the step, which environments of a batch share: sweep it"
            )
        if reason := inapplicable(study, setting, study.parameters[name]):
            raise ValueError(f"parameter {name!r} has no effect with the settings {setting!r}: {reason}; name other parameters")
    if len(names) < least:
        raise ValueError(f"{study.name} has {counted(len(names), 'parameter')} with low and high, must have at least {least}")
    check_value_conflicts({name: study.parameters[name] for name in names}, study.loaded[0])
    return study, names


def _design(stats: Any, study: Study, names: Sequence[str], samples: int) -> tuple[Array, Array, list[Array]]:
    """Points of Saltelli's design, (samples, parameters) each: matrices A and B, and A with each parameter's column from B."""
    sampler = stats.qmc.Sobol(d=2 * len(names), rng=np.random.default_rng([study.seed, 2]))
    unit = sampler.random(samples)
    low, high = (np.array([getattr(study.parameters[name], end) for name in names], float) for end in ("low", "high"))
    both = low + (high - low) * unit.reshape(samples, 2, len(names))
    first, second = both[:, 0], both[:, 1]
    mixed = []
    for k in range(len(names)):
        own = first.copy()
        own[:, k] = second[:, k]
        mixed.append(own)
    return first, second, mixed


def _indices(stats: Any, study: Study, values: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """Total and first-order Sobol indices, (parameters,), and the ends of their 95 % intervals, (parameters, 2).

    `values` has the outcome of every point, (points,), of the matrices of `_design`, n points each. Intervals are percentiles over
    resampled points. The corrected percentiles of SciPy's bootstrap are NaN for parameters without effect.
    """
    rows = values.reshape(-1, n)

    def indices_of(some: NDArray[np.int64]) -> tuple[Array, Array]:
        """Total and first-order Sobol indices, (parameters,) each, computed from the samples with the indices `some`."""
        a, b, *mixed = rows[:, some]
        if np.ptp([a, b]) == 0.0:
            # Without variance, the indices (fractions of the variance) are undefined.
            return np.full(len(mixed), np.nan), np.full(len(mixed), np.nan)
        found = stats.sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": np.array(mixed)[:, None]}, n=n)
        return found.total_order, found.first_order

    total, first = indices_of(np.arange(n))
    rng = np.random.default_rng([study.seed, 3])
    again = np.array([indices_of(rng.integers(n, size=n)) for _ in range(_RESAMPLES)])
    ends = np.nanpercentile(again, [2.5, 97.5], axis=0)
    return total, first, ends[:, 0].T, ends[:, 1].T


def _values(study: Study, rows: Sequence[dict[str, Any]]) -> Array:
    """Mean outcome over the episodes of each point of a ranking, (points,)."""
    name, values = measured(study), main_values(study, rows)
    if not np.isfinite(values).all():
        lost = sum(map(diverged, rows))
        why = f" ({lost} of them diverged)" if lost else ""
        raise ValueError(
            f"{name} is not finite in {int((~np.isfinite(values)).sum())} of {len(values)} episodes{why}, so that it has no variance; "
            "give the outcome a success"
        )
    points: Array = values.reshape(-1, study.episodes).mean(axis=1)
    if np.ptp(points) == 0.0:
        same, or_else = f"{name} is the same at all {len(points)} points", "choose another outcome"
        if study.success_outcome is not None:
            same = (
                f"as many episodes succeed at all {len(points)} points, {points[0]:.0%} of them by {name} {study.success_outcome.success}"
            )
            or_else = f"change the condition of success, or remove it: the ranking then uses {name} itself"
        raise ValueError(f"{same}, so that no parameter has an effect; widen their ranges, or {or_else}")
    return points


def _thirds(study: Study, values: Array, column: Array) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Mean outcomes in the lowest, middle and highest third of a parameter's range, and their 95 % intervals.

    A third of the range is represented by a third of the points, which are sorted by the parameter's values, (points,) each.
    """
    order = np.argsort(column, kind="stable")
    parts = [_average(study, values[own]) for own in np.array_split(order, _THIRDS)]
    return tuple(mean for mean, _ in parts), tuple(ends for _, ends in parts)


def _average(study: Study, values: Array) -> tuple[float, tuple[float, float]]:
    """Mean outcome over all points of a ranking, and its 95 % interval.

    Each point is one trial, because only points are independent, not their episodes.
    """
    mean = float(values.mean())
    if study.success_outcome is not None:
        return mean, wilson(round(float(values.sum())), len(values))
    error = 2.0 * float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return mean, (mean - error, mean + error)


def _sections(found: Ranking, samples: int, picture: Path | None) -> list[Section]:
    """Sections of the document of a ranking."""
    study = found.study
    share = study.success_outcome is not None
    what = f"the success of {measured(study)}" if share else measured(study)
    mean = f"{found.outcome:.3g} ({found.interval[0]:.3g} to {found.interval[1]:.3g})"
    words = [
        f"All of {counted(len(found.ranks), 'parameter')} drawn at once from their ranges, uniformly: "
        f"{samples * (2 + len(found.ranks))} points of {counted(study.episodes, 'episode')}, with the settings {found.setting!r}. "
        f"Mean of {what} over them: {mean}.",
        f"The total index is the share of the variance of {what} that remains when all other parameters are known. The first index is the "
        "share that the parameter explains alone; the difference is due to interactions. Intervals are about 95 %, by bootstrap over the "
        "points. Parameters whose intervals of the total index overlap are in no certain order.",
    ]
    if lost := sum(map(diverged, found.table.rows)):
        words.append(f"{lost} of {counted(len(found.table), 'episode')} diverged, and count as failures.")
    head = ("parameter", "range", "total index", "95 %", "first index", "95 %", "lowest third", "middle", "highest third", "source")
    rows = []
    for own in found.ranks:
        parameter = study.parameters[own.parameter]
        values = [f"{mean:.3g} ({low:.2g} to {high:.2g})" for mean, (low, high) in zip(own.thirds, own.intervals, strict=True)]
        rows.append([
            own.parameter,
            f"{parameter.low:g} to {parameter.high:g} {parameter.unit}".strip(),
            *(own.total, "{:.2f} to {:.2f}".format(*own.total_interval), own.first, "{:.2f} to {:.2f}".format(*own.first_interval)),
            *values,
            parameter.source,
        ])  # fmt: skip
    return [Section("Which parameters decide", words, head, rows, picture)]


def _draw(found: Ranking, path: Path) -> Path:
    """Draws Sobol indices as bars with intervals, and mean outcomes in the thirds of each parameter's range. Returns the path."""
    figure = require("matplotlib.figure", "to draw a ranking").Figure(
        figsize=(9.0, 1.2 + 0.42 * len(found.ranks)), dpi=130, layout="constrained"
    )
    left, right = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(found.ranks))[::-1]
    for shift, kind, colour in ((0.17, "total", "#0b3c8c"), (-0.17, "first", "#1f9e77")):
        values = np.array([getattr(own, kind) for own in found.ranks])
        ends = np.array([getattr(own, f"{kind}_interval") for own in found.ranks]).T
        left.barh(places + shift, values, 0.3, color=colour, label=f"{kind} index", alpha=0.75)
        left.hlines(places + shift, *ends, color="black", linewidth=1.2)
    left.axvline(0.0, color="#888888", linewidth=0.8)
    left.set_yticks(places, [own.parameter for own in found.ranks])
    left.set_xlabel("share of the variance, 95 %")
    for third, (name, colour) in enumerate((("lowest third", "#9ecae1"), ("middle", "#4292c6"), ("highest third", "#08306b"))):
        values = np.array([own.thirds[third] for own in found.ranks])
        ends = np.array([own.intervals[third] for own in found.ranks]).T
        at = places + 0.22 * (1 - third)
        right.plot(values, at, "o", color=colour, label=f"{name} of the range", markersize=4)
        right.hlines(at, *ends, color=colour, linewidth=1.2)
    outcome = found.study.success_outcome or found.study.all_outcomes[0]
    unit = f", {outcome.unit}" if outcome.unit and found.study.success_outcome is None else ""
    right.set_xlabel(f"share of successes ({outcome.name} {outcome.success})" if outcome.success else f"mean {outcome.name}{unit}")
    # The legend is below the panels, where it covers no interval.
    entries = zip(left.get_legend_handles_labels(), right.get_legend_handles_labels(), strict=True)
    handles, labels = (ours + theirs for ours, theirs in entries)
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=8)
    for panel in (left, right):
        panel.grid(visible=True, axis="x", color="#dddddd")
        panel.set_axisbelow(True)
    figure.suptitle(f"{found.study.name}: which parameters decide", fontsize=11)
    return write_figure(path, figure)
