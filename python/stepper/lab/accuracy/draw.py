"""Picture of a chart: error against cost (alone and in a batch), and sources of errors."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepper.lab.accuracy.candidates import pareto
from stepper.lab.accuracy.costs import BATCH
from stepper.lab.accuracy.measure import CAUSES, Dot
from stepper.lab.accuracy.reference import Reference
from stepper.lab.accuracy.traces import Distance
from stepper.lab.study.study import Study
from stepper.shared.files import write_figure
from stepper.shared.machine import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
_OURS = ("#0b3c8c", "#2ca02c", "#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#00695c")
_LAW = ("#6a1b9a", "#ab47bc")
_THEIRS = ("#d62728", "#ff7f0e", "#b8860b")
"""Colours of lines: stepper with hard contact, stepper with MuJoCo's contact law, and MuJoCo."""
_F32_SUFFIX = ", f32"
"""End of the label of a line with 32-bit precision."""
_FLOOR = 1e-12
"""Smallest error that is drawn; smaller errors are drawn at this value."""


def draw(study: Study, distance: Distance, reference: Reference, dots: Sequence[Dot], *, path: Path, note: str) -> Path:
    """Draws the chart into a PNG file: error against cost, and sources of errors. Returns the path.

    Args:
        study: The study.
        distance: Definition of errors: unit and horizon.
        reference: Run relative to which errors were measured.
        dots: Points of the chart.
        path: The PNG file.
        note: Last line of the title.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    figures = require("matplotlib.figure", "to draw a chart")
    figure = figures.Figure(figsize=(13, 11.5), dpi=120, layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0))
    labels = list(dict.fromkeys(dot.label for dot in dots))
    colours = _colours(labels)
    markers = dict(zip(sorted({dot.timestep for dot in dots}), MARKERS, strict=False))
    panels = [figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])]
    for panel, cost, title in zip(
        panels, ("us_single_env", "batch"), ("one environment alone", f"{BATCH} environments in a batch"), strict=True
    ):
        _panel(panel, dots, cost, colours, markers)
        low = float(np.median(reference.ground_truth_uncertainty))
        low = low if math.isfinite(low) else _FLOOR
        panel.axhspan(_FLOOR, max(low, 2 * _FLOOR), color="#888888", alpha=0.15, linewidth=0)
        panel.set_title(title, fontsize=11)
        panel.set_xlabel("cost, us of one core for a simulated second\nof one environment (down and left is better)", fontsize=9)
        panel.set_ylabel(f"error up to {distance.horizon:.3g} s, {distance.unit} (median)")
        finite = [dot.error for dot in dots if math.isfinite(dot.error) and dot.error > 0]
        if finite:
            panel.set_ylim(max(_FLOOR, 0.3 * min([*finite, max(low, _FLOOR)])), 3 * max(finite))
    _legends(figure, panels, markers)
    _causes_panel(figure.add_subplot(grid[1, :]), study, dots, labels, colours)
    title = "\n".join(textwrap.wrap(f"{study.name}. Reference: {reference.words}", 150))
    figure.suptitle(f"{title}\n{note}", fontsize=9)
    return write_figure(path, figure)


def _colours(labels: Sequence[str]) -> dict[str, str]:
    """Colour of each line of the chart, by label (engine and settings).

    Settings that differ only in precision have the same colour, and another line style.
    """
    found: dict[str, str] = {}
    counts = {"ours": 0, "law": 0, "theirs": 0}
    for label in labels:
        same = label.removesuffix(_F32_SUFFIX)
        if same not in found:
            kind = "theirs" if label.startswith("MuJoCo:") else "law" if "MuJoCo's law" in label else "ours"
            palette = {"ours": _OURS, "law": _LAW, "theirs": _THEIRS}[kind]
            found[same] = palette[counts[kind] % len(palette)]
            counts[kind] += 1
        found[label] = found[same]
    return {label: found[label] for label in labels}


def _line(label: str) -> str:
    """Matplotlib's style of a line of the chart (solid, dashed ...), from the engine and precision in its label."""
    return "--" if label.startswith("MuJoCo:") else ":" if label.endswith(_F32_SUFFIX) else "-"


def _panel(panel: Axes, dots: Sequence[Dot], cost: str, colours: dict[str, str], markers: dict[float, str]) -> None:
    """Draws error against cost into a panel, with a line for each engine and settings, a marker per time step, and the Pareto front."""
    good = [dot for dot in dots if math.isfinite(dot.error) and math.isfinite(getattr(dot, cost))]
    for label, colour in colours.items():
        own = [dot for dot in good if dot.label == label]
        x, y = [getattr(dot, cost) for dot in own], [max(dot.error, _FLOOR) for dot in own]
        panel.plot(x, y, _line(label), color=colour, linewidth=1.4, label=label if own else f"{label} (no point)")
    # One artist draws the markers of all lines for a time step, because drawing some hundred artists takes seconds.
    for timestep, marker in markers.items():
        some = [dot for dot in good if dot.timestep == timestep]
        x, y = [getattr(dot, cost) for dot in some], [max(dot.error, _FLOOR) for dot in some]
        shades = [colours[dot.label] for dot in some]
        panel.scatter(x, y, 30, shades, marker=marker, edgecolors="white", linewidths=0.5, zorder=3)
    best = [good[k] for k in pareto([getattr(dot, cost) for dot in good], [dot.error for dot in good])]
    x, y = [getattr(dot, cost) for dot in best], [max(dot.error, _FLOOR) for dot in best]
    panel.plot(x, y, color="#ffcc00", linewidth=6, alpha=0.45, zorder=0, label="Pareto front", drawstyle="steps-post")
    _scale(panel, "xy", there=bool(good))
    panel.grid(visible=True, color="#dddddd")
    panel.set_axisbelow(True)


def _scale(panel: Axes, axes: str, *, there: bool) -> None:
    """Sets logarithmic axes, or writes a note into a panel without points."""
    if not there:
        panel.text(0.5, 0.5, "nothing was measured: see the notes of the rows", transform=panel.transAxes, ha="center", fontsize=11)
        return
    if "x" in axes:
        panel.set_xscale("log")
    if "y" in axes:
        panel.set_yscale("log")


def _legends(figure: Figure, panels: Sequence[Axes], markers: dict[float, str]) -> None:
    """Adds legends for the time steps and for the settings to the picture of a chart."""
    lines = require("matplotlib.lines", "to draw a chart")
    marks = [
        lines.Line2D([], [], marker=mark, color="#444444", linestyle="none", label=f"{dt * 1e3:.4g} ms") for dt, mark in markers.items()
    ]
    panels[1].legend(handles=marks, title="time step", fontsize=8, loc="best")
    handles, labels = panels[0].get_legend_handles_labels()
    # The handles are long enough to show dots and dashes.
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=3, frameon=False, handlelength=3.5)


def _causes_panel(panel: Axes, study: Study, dots: Sequence[Dot], labels: Sequence[str], colours: dict[str, str]) -> None:
    """Draws bars for the parts of the error (solver, time step, model) at the study's time step."""
    own = study.options.timestep or float(study.loaded[0].timestep)
    chosen = [min((dot for dot in dots if dot.label == label), key=lambda dot: abs(dot.timestep - own)) for label in labels]
    place, there = np.arange(len(chosen)), False
    for k, ((name, label), colour) in enumerate(zip(CAUSES.items(), ("#1f77d0", "#2ca02c", "#d62728"), strict=True)):
        values = [getattr(dot, name) for dot in chosen]
        shown = [v if math.isfinite(v) and v > _FLOOR else np.nan for v in values]
        panel.bar(place + 0.25 * (k - 1), shown, 0.24, color=colour, label=label)
        there = there or bool(np.isfinite(shown).any())
    _scale(panel, "y", there=there)
    panel.set_xticks(place, [dot.label for dot in chosen], rotation=25, ha="right", fontsize=8)
    panel.set_ylabel("median error by its cause")
    panel.set_title(f"where errors come from, at the time step of {own * 1e3:g} ms", fontsize=11)
    panel.legend(fontsize=8)
    panel.grid(visible=True, axis="y", color="#dddddd")
    panel.set_axisbelow(True)
