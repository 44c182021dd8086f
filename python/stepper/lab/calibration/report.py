"""Report of a calibration: what to measure, how accurately and by which experiment, what need not be known, and what was assumed."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepper.lab.calibration.search import SHARE, Trial
from stepper.lab.study.document import Document, Section, counted
from stepper.lab.study.parameters import Parameter
from stepper.lab.study.report import settings_sections
from stepper.lab.study.sweep import measured
from stepper.shared.files import write_figure
from stepper.shared.machine import package_version, require
from stepper.sysid.parameters import KINDS

if TYPE_CHECKING:
    from stepper.lab.calibration.calibrate import Calibration

_STYLES = ("-", "--", ":", "-.")
"""Line styles of the curves without one parameter."""
_COLOURS = {"nothing": "#999999", "set": "#0b3c8c", "left out": "#d95f02"}
"""Colours of parameters and curves."""


def document_of(found: Calibration, folder: Path) -> tuple[Document, list[Path]]:
    """Document of a calibration, and its pictures, which are written to a folder."""
    pictures = [_draw(found, folder / "calibrate.png")] if package_version("matplotlib") else []
    sections = [_answer(found, pictures[0] if pictures else None), *_measure(found), _keep(found), _assumed(found)]
    sections += settings_sections(found.study, len(found.table), "calibrate_table")
    return Document(f"Calibration of {found.study.name}", sections), pictures


def _what(found: Calibration) -> str:
    """Outcome that is compared, in words."""
    name = measured(found.study)
    return f"the fraction of successes ({name} {found.study.success_outcome.success})" if found.study.success_outcome else f"{name}"


def _answer(found: Calibration, picture: Path | None) -> Section:
    """Section with the set and its certificate."""
    last, names = found.certificates[-1], ", ".join(own.name for own in found.parameters) or "nothing"
    trial, margin = last.trial, f"{found.margin:g}"
    words = [
        f"To measure: {names}. {counted(len(found.unmeasured), 'other parameter')} may keep nominal values.",
        f"Compared: {_what(found)} of {counted(found.study.episodes, 'episode')} in a world and in its model, with the same starts and "
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
    return Section("Answer", words, picture=picture)


def _measure(found: Calibration) -> list[Section]:
    """Section on what to measure, how accurately and by which experiment, and on what shows that less would fail."""
    if not found.parameters:
        return []
    ranks = {entry.parameter: entry for entry in found.ranking.ranks}
    rows = []
    for own in found.parameters:
        parameter = found.study.parameters[own.name]
        rows.append([
            own.name,
            f"{parameter.low:g} to {parameter.high:g} {parameter.unit}".strip(),
            f"± {own.tolerance:.3g} {parameter.unit}".strip(),
            "{:.2f} ({:.2f} to {:.2f})".format(ranks[own.name].total, *ranks[own.name].total_interval),
            _shown(own.weaker["left out"]),
            "; ".join(f"{change} {_shown(trial)}" for change, trial in own.weaker.items() if change != "left out"),
            experiment_for(parameter),
            parameter.source,
        ])  # fmt: skip
    head = ("parameter", "range", "measure to", "total index", "left out", "wider tolerance", "experiment", "source of the range")
    words = [
        "Weaker alternatives ran in further worlds: the nominal value in place of the measured one, and wider tolerances. Cells have the "
        f"number of worlds that exceed the margin. An alternative fails if this proves that more than {1.0 - SHARE:.0%} of all worlds do, "
        "with 95 % confidence; otherwise its failure is not shown."
    ]
    return [Section("What to measure", words, head, rows)]


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
    ranks = {entry.parameter: entry for entry in found.ranking.ranks}
    rows = []
    for name in found.unmeasured:
        parameter = found.study.parameters[name]
        nominal = "the model's number" if parameter.unchanged is None else f"{parameter.unchanged:g} {parameter.unit}".strip()
        index = "{:.2f} ({:.2f} to {:.2f})".format(ranks[name].total, *ranks[name].total_interval)
        rows.append([name, f"{parameter.low:g} to {parameter.high:g} {parameter.unit}".strip(), nominal, index, parameter.source])
    words = ["The certificate covers all values of these parameters in their ranges."] if rows else ["None: all parameters matter."]
    return Section("What need not be known", words, ("parameter", "range", "nominal value", "total index", "source of the range"), rows)


def _assumed(found: Calibration) -> Section:
    """Section on what the certificate assumes."""
    words = [
        "Parameters of the true world are independent and uniform in their ranges. A range that leaves out the true value makes the "
        "certificate void; one that is too wide makes it demand too much.",
        "The real system is one of the simulated worlds: a phenomenon that no parameter describes is not covered. Only recordings of the "
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
    styles = itertools.cycle(_STYLES)
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
