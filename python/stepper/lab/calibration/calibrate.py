"""Smallest set of parameters that must be measured (`stepper.lab.calibrate`), with a certificate.

A policy or controller was made in the simulator. It transfers if its outcome on the real system is that in the simulator, to within a
margin. `calibrate` finds which parameters of the simulator must be measured for that, how accurately, and which may keep nominal values.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stepper.lab.calibration.search import SHARE, UNMEASURED, Array, Certificate, Search, Space, Trial, confidence_of, worlds_for
from stepper.lab.study.batches import USUAL, Point, nominal_of, run_points
from stepper.lab.study.document import Document, Section, counted
from stepper.lab.study.journal import Journal, Results, Row, Table
from stepper.lab.study.parameters import Parameter
from stepper.lab.study.ranking import Ranking, rank
from stepper.lab.study.report import settings_sections, study_of
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import main_values, measured
from stepper.shared.arguments import check_number, check_whole
from stepper.shared.files import write_figure, write_text
from stepper.shared.machine import package_version, require
from stepper.shared.progress import ProgressCallback
from stepper.sysid.parameters import KINDS

_SEARCH, _CERTIFICATE, _MINIMALITY = 4, 5, 6
"""Second of the numbers that seed the worlds of the search, of certificates, and of the proof of minimality."""
_COMPARISONS = 8
"""Usual number of comparisons of sets per parameter, for the progress display."""


@dataclass(frozen=True)
class MeasuredParameter:
    """Parameter that must be measured.

    Attributes:
        name: Name of the parameter.
        tolerance: Largest error of the measurement, in the unit of the parameter.
        weaker: Results of weaker alternatives by name, in worlds that were not used before. With "left out", the parameter is nominal. With
            "x2", "x4", ... the tolerance is wider; the last of them surely fails, or exceeds half the range.
    """

    name: str
    tolerance: float
    weaker: Mapping[str, Trial]


@dataclass(frozen=True)
class Calibration:
    """Result of `calibrate`.

    Attributes:
        study: The study.
        setting: Name of the settings.
        margin: Largest difference of the outcome, as a fraction of successes or in the unit of the outcome.
        parameters: Parameters that must be measured, the one with the largest total Sobol index first.
        unmeasured: Names of the parameters that may keep their nominal values.
        certificates: Certificate of each try; the last one is that of the result.
        nominal: Result without any measurement, on the worlds of the last certificate.
        doubled: Result with all tolerances doubled, in worlds that were not used before.
        ranking: Ranking of the parameters by Sobol indices.
        table: Table of all episodes.
        document: The report.
        files: Files that were written.
        searched: Whether the set and its tolerances were searched, not given.
    """

    study: Study
    setting: str
    margin: float
    parameters: tuple[MeasuredParameter, ...]
    unmeasured: tuple[str, ...]
    certificates: tuple[Certificate, ...]
    nominal: Trial
    doubled: Trial
    ranking: Ranking
    table: Table
    document: Document
    files: tuple[Path, ...]
    searched: bool = True

    @property
    def holds(self) -> bool:
        """Whether the certificate of the last try holds."""
        return self.certificates[-1].holds

    def __str__(self) -> str:
        return self.document.markdown()


class Comparison:
    """Difference of the outcome between worlds and their models, from episodes with the same starts and random numbers.

    With a condition of success, the difference is that of the fractions of successes. Without one, it is the mean over the episodes of the
    absolute difference of the outcome, in which errors of different signs do not cancel.

    Args:
        study: The study.
        names: Names of the parameters.
        setting: Name of the settings.
        journal: Journal of the study.
        progress: Function that is called with the number of finished comparisons.
    """

    def __init__(self, study: Study, names: Sequence[str], setting: str, journal: Journal, progress: Callable[[int], None]):
        self._study, self._names, self._setting, self._journal, self._progress = study, names, setting, journal, progress
        self.rows: dict[str, Row] = {}
        self._count = 0

    def __call__(self, worlds: Array, models: Array) -> Array:
        """Difference of the outcome for each world (n, parameters) and its model, (n,)."""
        # A NaN keeps the model's number; parameters that do not vary are nominal.
        given = [dict(zip(self._names, row, strict=True)) for row in np.concatenate([worlds, models]).tolist()]
        nominal = nominal_of(self._study, self._setting)
        points = [Point(nominal | {n: x for n, x in own.items() if not math.isnan(x)}, self._setting) for own in given]
        rows = run_points(self._study, points, self._journal)
        self.rows |= {row["key"]: row for row in rows}
        self._count += 1
        self._progress(self._count)
        world, model = main_values(self._study, rows).reshape(2, len(worlds), self._study.episodes)
        if self._study.success_outcome is not None:
            world, model = world.mean(axis=1, keepdims=True), model.mean(axis=1, keepdims=True)
        return np.asarray(np.abs(world - model).mean(axis=1))


def calibrate(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str] = "out",
    *,
    margin: float,
    samples: int = 64,
    worlds: int = 208,
    tries: int = 3,
    parameters: Sequence[str] | None = None,
    tolerances: Mapping[str, float] | None = None,
    setting: str = USUAL,
    progress: ProgressCallback | None = None,
) -> Calibration:
    """Finds the smallest set of parameters that must be measured, so that the outcome is that of the true world to within a margin.

    A world is a set of parameter values, drawn uniformly and independently from the ranges. Its model has the measured parameters with an
    error as large as the tolerance, of either sign, and nominal values of the others. Both run the same episodes. The certificate is: in
    at least 95 % of plausible worlds the difference of the outcome is at most the margin, with 95 % confidence. Finished episodes are kept
    on disk and not repeated.

    Args:
        study: A study, or its file.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        margin: Largest difference of the fraction of successes, or of the outcome in its unit if the study has no condition of success.
        samples: Number of base samples of the ranking, a power of 2.
        worlds: Number of worlds of each certificate, of the search, and of the proof of minimality.
        tries: Largest number of certificates that are tried. The probability of an error is divided among them.
        parameters: Names, or selectors with a range; None selects all parameters with low and high.
        tolerances: Tolerances of measurements by parameter, in its unit. They get the certificate, in one try, without a search. None
            searches the set and its tolerances.
        setting: Name of the settings.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The result. OUT/NAME has calibrate.html, calibrate.md, calibrate.png, calibrate.json, calibrate_table.csv, calibrate_table.npz, and
        the files of `rank`.

    Raises:
        ValueError: As in `rank`; or the margin is not above 0; or there are too few worlds for a certificate; or no tolerance passes. Also
            if a tolerance is given for an unknown parameter, or is not above 0.
        MissingPackageError: SciPy is not installed.
    """
    study = study_of(study)
    check_number("margin", margin, above=0.0)
    check_whole("tries", tries, least=1)
    check_whole("worlds", worlds, least=1)
    tries = tries if tolerances is None else 1
    if worlds < (n := worlds_for(0, tries)):
        raise ValueError(f"worlds is {worlds}, must be at least {n} for a certificate with {tries} tries: give more worlds or fewer tries")
    ranking = rank(study, out, samples=samples, parameters=parameters, setting=setting, progress=progress)
    study, names = ranking.study, [entry.parameter for entry in ranking.ranks]
    space = _space(study, names)
    given = None if tolerances is None else _fractions(tolerances, names, space)
    importance = np.array([entry.total for entry in ranking.ranks])
    with Results(study, out) as results:
        at = progress or (lambda *_: None)
        done = lambda n: at(f"calibrate {study.name}", min(0.99, n / (_COMPARISONS * len(names))))  # noqa: E731
        comparison = Comparison(study, names, setting, results.journal, done)
        search = Search(comparison, space, margin, importance, count=worlds, rng=np.random.default_rng([study.seed, _SEARCH]))
        chosen, fractions, certificates = _certified(search, study.seed, worlds, tries, given)
        last = certificates[-1].trial
        fresh = space.draw(np.random.default_rng([study.seed, _CERTIFICATE, len(certificates)]), worlds)
        nominal = last if not chosen else search.trial(np.full(len(names), UNMEASURED), *fresh)
        proof = space.draw(np.random.default_rng([study.seed, _MINIMALITY]), worlds)
        widths = space.high - space.low
        required = tuple(MeasuredParameter(names[k], float(fractions[k] * widths[k]), search.weaker(fractions, k, *proof)) for k in chosen)
        left = tuple(name for k, name in enumerate(names) if k not in chosen)
        found = Calibration(
            study, setting, margin, required, left, tuple(certificates), nominal, search.trial(2.0 * fractions, *proof), ranking,
            Table(list(comparison.rows.values())), Document(""), (), tolerances is None,
        )  # fmt: skip
        pictures = [_draw(found, results.folder / "calibrate.png")] if package_version("matplotlib") else []
        sections = [_answer(found, pictures[0] if pictures else None), *_measure(found), _keep(found), _assumed(found)]
        sections += settings_sections(study, len(found.table), "calibrate_table")
        document = Document(f"Calibration of {study.name}", sections)
        files = [*found.table.save(results.folder, "calibrate_table"), *document.save(results.folder, "calibrate"), *pictures]
        files.append(write_text(results.folder / "calibrate.json", json.dumps(summary(found), indent=2) + "\n"))
        if progress:
            progress(f"calibrate {study.name}", 1.0)
    return replace(found, document=document, files=(*ranking.files, *files))


def _space(study: Study, names: Sequence[str]) -> Space:
    """Plausible worlds of a study. Parameters without a nominal value have NaN, which keeps the model's number."""
    ends = np.array([[study.parameters[name].low, study.parameters[name].high] for name in names], float)
    unchanged = [study.parameters[name].unchanged for name in names]
    return Space(ends[:, 0], ends[:, 1], np.array([np.nan if value is None else float(value) for value in unchanged]))


def _fractions(tolerances: Mapping[str, float], names: Sequence[str], space: Space) -> Array:
    """Given tolerances as fractions of the ranges, (parameters,); `UNMEASURED` for all other parameters."""
    if unknown := set(tolerances) - set(names):
        raise ValueError(f"tolerances has {sorted(unknown)}, which are no parameters that vary: choose from {', '.join(names)}")
    for name, tolerance in tolerances.items():
        check_number(f"tolerance of {name}", tolerance, above=0.0)
    return np.array([tolerances.get(name, UNMEASURED) for name in names]) / (space.high - space.low)


def _certified(search: Search, seed: int, worlds: int, tries: int, given: Array | None) -> tuple[list[int], Array, list[Certificate]]:
    """Set, tolerances and certificates of all tries, of which the last one holds unless all fail. Given tolerances are tried once."""
    certificates: list[Certificate] = []
    for number in range(1, tries + 1):
        if given is None:
            chosen = search.smallest()
            tolerances = search.widest(chosen)
        else:
            chosen, tolerances = [k for k, tolerance in enumerate(given) if np.isfinite(tolerance)], given
        drawn = search.space.draw(np.random.default_rng([seed, _CERTIFICATE, number]), worlds)
        certificates.append(Certificate(search.trial(tolerances, *drawn), confidence_of(tries), number, tries))
        if certificates[-1].holds:
            break
        # The next set must pass in these worlds too. Its certificate is tried on other worlds.
        search.add(*drawn)
    return chosen, tolerances, certificates


def summary(found: Calibration) -> dict[str, Any]:
    """Result of a calibration as JSON types."""
    last, study = found.certificates[-1], found.study
    about = {"study": study.name, "seed": study.seed, "setting": found.setting, "outcome": measured(study), "margin": found.margin}
    measure: dict[str, Any] = {}
    for own in found.parameters:
        violations = {change: trial.violations for change, trial in own.weaker.items()}
        fails = [change for change, trial in own.weaker.items() if trial.fails_surely]
        measure[own.name] = {"tolerance": own.tolerance, "violations_if": violations, "surely_fails_if": fails}
    return about | {
        "holds": found.holds,
        "searched": found.searched,
        "measure": measure,
        "keep_nominal": list(found.unmeasured),
        "worlds": last.trial.worlds,
        "violations": [certificate.trial.violations for certificate in found.certificates],
        "confidence_per_try": last.confidence,
        "violating_share_at_most": last.bound,
        "quantile": last.trial.quantile(last.confidence),
        "violations_without_measurement": found.nominal.violations,
        "violations_if_all_doubled": found.doubled.violations,
        "all_doubled_surely_fails": found.doubled.fails_surely,
    }


_COLOURS = {"nothing": "#999999", "set": "#0b3c8c", "left out": "#d95f02"}
"""Colours of parameters and curves."""


def _answer(found: Calibration, picture: Path | None) -> Section:
    """Section with the set and its certificate."""
    last, names = found.certificates[-1], ", ".join(own.name for own in found.parameters) or "nothing"
    trial, margin, outcome, success = last.trial, f"{found.margin:g}", measured(found.study), found.study.success_outcome
    what = f"the fraction of successes ({outcome} {success.success})" if success else outcome
    words = [
        f"To measure: {names}. {counted(len(found.unmeasured), 'other parameter')} may keep nominal values.",
        f"Compared: {what} of {counted(found.study.episodes, 'episode')} in a world and in its model, with the same starts and "
        f"random numbers, with the settings {found.setting!r}. Margin: {margin}.",
    ]
    claim = f"in at least {SHARE:.0%} of plausible worlds the difference is at most {margin}, with {last.confidence:.1%} confidence"
    result = f"{trial.violations} of {trial.worlds} fresh worlds exceed the margin, so at most {last.bound:.1%} of all do"
    if found.holds:
        words.append(f"**Certificate: {claim}.** {result}. At least {SHARE:.0%} differ by at most {trial.quantile(last.confidence):.3g}.")
    else:
        words.append(
            f"**No certificate.** The claim would be: {claim}. But {result}. Widen the margin, or give the search more worlds or episodes."
        )
    if len(found.certificates) > 1 or last.tries > 1:
        counts = ", ".join(str(own.trial.violations) for own in found.certificates)
        words.append(
            f"Try {last.number} of {last.tries} planned tries; violations in each: {counts}. Each try has the confidence "
            f"{last.confidence:.1%}, so that all tries together have 95 %."
        )
    words.append(f"Without any measurement, {found.nominal.violations} of {found.nominal.worlds} worlds exceed the margin.")
    if found.parameters:
        words.append(f"All tolerances doubled, in further worlds: {_shown(found.doubled)} worlds exceed the margin.")
    return Section("Answer", words, picture=picture)


def _measure(found: Calibration) -> list[Section]:
    """Section on what to measure, how accurately and by which experiment, and on what shows that less would fail."""
    if not found.parameters:
        return []
    rows = []
    for own in found.parameters:
        parameter = found.study.parameters[own.name]
        name, ends, index = _cells(found, own.name)
        tolerance = f"± {own.tolerance:.3g} {parameter.unit}".strip()
        wider = "; ".join(f"{change} {_shown(trial)}" for change, trial in own.weaker.items() if change != "left out")
        rows.append([name, ends, tolerance, index, _shown(own.weaker["left out"]), wider, experiment_for(parameter), parameter.source])
    head = ("parameter", "range", "measure to", "total index", "left out", "wider tolerance", "experiment", "source of the range")
    words = [
        "Weaker alternatives ran in further worlds: the nominal value in place of the measured one, and wider tolerances. Cells have the "
        f"number of worlds that exceed the margin. An alternative fails if this proves that more than {1.0 - SHARE:.0%} of all worlds do, "
        "with 95 % confidence; otherwise its failure is not shown."
    ]
    return [Section("What to measure", words, head, rows)]


def _cells(found: Calibration, name: str) -> list[str]:
    """Cells with the name of a parameter, its range, and its total Sobol index."""
    parameter, entry = found.study.parameters[name], next(entry for entry in found.ranking.ranks if entry.parameter == name)
    index = "{:.2f} ({:.2f} to {:.2f})".format(entry.total, *entry.total_interval)
    return [name, f"{parameter.low:g} to {parameter.high:g} {parameter.unit}".strip(), index]


def _shown(trial: Trial) -> str:
    """Cell with the violations of a weaker alternative, and whether it surely fails."""
    return f"{'fails' if trial.fails_surely else 'not shown'}: {trial.violations} of {trial.worlds}"


def experiment_for(parameter: Parameter) -> str:
    """Motion that determines a parameter, in words, as `stepper.sysid` advises."""
    selector = parameter.parsed
    columns = "" if selector.columns is None else f"[{','.join(map(str, selector.columns))}]"
    if (kind := KINDS.get(selector.field + columns)) is None:
        return "direct measurement"
    names = ", ".join(map(str, selector.elements)) if selector.elements is not None else f"each {kind.element}"
    return kind.excite.format(names)


def _keep(found: Calibration) -> Section:
    """Section on the parameters that may keep nominal values."""
    rows = []
    for name in found.unmeasured:
        parameter, (_, ends, index) = found.study.parameters[name], _cells(found, name)
        nominal = "the model's number" if parameter.unchanged is None else f"{parameter.unchanged:g} {parameter.unit}".strip()
        rows.append([name, ends, nominal, index, parameter.source])
    words = ["The certificate covers all values of these parameters in their ranges."] if rows else ["None: all parameters matter."]
    return Section("What need not be known", words, ("parameter", "range", "nominal value", "total index", "source of the range"), rows)


def _assumed(found: Calibration) -> Section:
    """Section on what the certificate assumes."""
    words = [
        "Parameters of the true world are independent and uniform in their ranges. A range that leaves out the true value makes the "
        "certificate void; one that is too wide makes it demand too much.",
        "The real system is one of the simulated worlds: a phenomenon that no parameter describes is not covered. Only measurements of the "
        "real system can show that it is missing.",
        "Every measurement errs by exactly its tolerance, up or down with equal probability, independently of the others.",
        f"The outcome is that of {counted(found.study.episodes, 'episode')} per world with the study's seed, not the expectation over all "
        "episodes. Worlds and their models share starts and random numbers.",
        "The set is the smallest if a measurement of one more parameter never makes a model worse. The table above shows for each "
        "parameter of the set that less fails; it does not compare all sets of the same size."
        if found.searched
        else "The set and its tolerances were given, not searched. A smaller set may pass unless the table above shows that it fails.",
    ]
    return Section("What was assumed", words)


def _draw(found: Calibration, path: Path) -> Path:
    """Draws Sobol indices, and the distributions of the difference over worlds. Returns the path."""
    names = [entry.parameter for entry in found.ranking.ranks]
    height = max(3.4, 1.2 + 0.35 * len(names))
    figure = require("matplotlib.figure", "to draw a calibration").Figure(figsize=(10.0, height), dpi=130, layout="constrained")
    left, right = figure.subplots(1, 2)
    needed = {own.name for own in found.parameters}
    places = np.arange(len(names))[::-1]
    ends = np.array([entry.total_interval for entry in found.ranking.ranks]).T
    colours = [_COLOURS["set" if name in needed else "nothing"] for name in names]
    left.barh(places, [entry.total for entry in found.ranking.ranks], 0.6, color=colours, alpha=0.8)
    left.hlines(places, *ends, color="black", linewidth=1.2)
    left.set_yticks(places, names)
    left.set_xlabel("total Sobol index, 95 % (blue: must be measured)")
    last = found.certificates[-1].trial
    curves = [("nothing measured", found.nominal, _COLOURS["nothing"], "-"), ("measured to the tolerances", last, _COLOURS["set"], "-")]
    styles = itertools.cycle(("-", "--", ":", "-."))
    curves += [(f"without {own.name}", own.weaker["left out"], _COLOURS["left out"], next(styles)) for own in found.parameters]
    for label, trial, colour, style in curves:
        shares = np.arange(1, trial.worlds + 1) / trial.worlds
        right.step(np.sort(trial.differences), shares, where="post", color=colour, linestyle=style, label=label)
    right.axvline(found.margin, color="black", linewidth=1.0)
    right.axhline(SHARE, color="black", linewidth=0.8, linestyle=":")
    right.annotate("margin", (found.margin, 0.02), xytext=(3, 0), textcoords="offset points", fontsize=8)
    finite = [trial.differences[np.isfinite(trial.differences)] for _, trial, *_ in curves]
    right.set_xlim(-0.02 * found.margin, max(2.0 * found.margin, *(float(values.max(initial=0.0)) for values in finite)) * 1.03)
    right.set_ylim(0.0, 1.01)
    right.set_xlabel("difference of the outcome between world and model")
    right.set_ylabel("fraction of worlds")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    for panel in (left, right):
        panel.grid(visible=True, color="#dddddd")
        panel.set_axisbelow(True)
    figure.suptitle(f"{found.study.name}: what must be measured", fontsize=11)
    return write_figure(path, figure)
