"""The picture of a sweep: a panel for every parameter, a line for every setting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper.experiments.study.document import counted
from stepper.experiments.study.points import USUAL
from stepper.experiments.study.sweep import Level, Sweep, measured
from stepper.shared.machine import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (
    *("#0b3c8c", "#1f9e77", "#7a3fb5", "#d62728", "#ff7f0e", "#8c564b", "#17a2b8", "#666666"),
    *("#e377c2", "#bcbd22", "#000000", "#9ecae1"),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "h", "p")
_COLUMNS = 3
_ANNOTATED = 5
"""Settings at the most whose cliffs the panels of a sweep name; more are read in `draw_cliffs`."""


def draw(sweep: Sweep, path: Path) -> Path:
    """Shares of successes with Wilson's intervals, or means with their standard errors, over the values of every parameter.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    figures = require("matplotlib.figure", "to draw a sweep")
    names = [name for name in sweep.study.parameters if any(level.parameter == name for level in sweep.levels)]
    columns = min(_COLUMNS, max(1, len(names)))
    lines = max(1, math.ceil(len(names) / columns))
    beneath = (0.9 if columns > 1 else 1.0) + 0.22 * math.ceil(len(sweep.study.settings) / 4)
    size = (max(7.5, 4.2 * columns + 0.6), 3.0 * lines + beneath)
    beneath = (0.9 if columns > 1 else 1.0) + 0.22 * math.ceil(len(sweep.study.settings) / 4)
    size = (max(7.5, 4.2 * columns + 0.6), 3.0 * lines + beneath)
    figure = figures.Figure(figsize=size, dpi=130, layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for panel, name in zip(axes, names, strict=False):
        _panel(panel, sweep, name)
    for panel in axes[len(names) :]:
        panel.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    if len(labels) > 1:
        if any(cliff.parameter in names for cliff in sweep.cliffs):
            artists = require("matplotlib.lines", "to draw a sweep")
            handles.append(artists.Line2D([], [], color="#444444", linestyle=":", linewidth=1))
            labels.append("where success ends")
        figure.legend(handles, labels, loc="outside lower center", ncols=min(4 if columns > 1 else 3, len(labels)), frameon=False)
    figure.suptitle(f"{sweep.study.name}: {measured(sweep.study)}, {counted(sweep.study.episodes, 'episode')} a point", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    return path


def draw_cliffs(sweep: Sweep, path: Path) -> Path | None:
    """Where success ends with each of the settings, a panel for every parameter; None where no parameter has cliffs of two settings.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    settings = [USUAL, *sweep.study.settings]
    own = {name: [cliff for cliff in sweep.cliffs if cliff.parameter == name] for name in sweep.study.parameters}
    names = [name for name, cliffs in own.items() if len({cliff.setting for cliff in cliffs}) > 1]
    if not names:
        return None
    figures = require("matplotlib.figure", "to draw cliffs")
    size = (max(6.0, 3.6 * len(names) + 1.8), 1.1 + 0.26 * len(settings))
    figure = figures.Figure(figsize=size, dpi=130, layout="constrained")
    axes = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for panel, name in zip(axes, names, strict=True):
        for cliff in own[name]:
            row = settings.index(cliff.setting)
            colour, middle = COLOURS[row % len(COLOURS)], (cliff.low + cliff.high) / 2
            panel.errorbar([middle], [row], xerr=[(cliff.high - cliff.low) / 2], fmt="o", color=colour, capsize=2, markersize=4)
            # Above the bracket, which may be longer than the number.
            panel.annotate(f"{middle:.4g}", (middle, row), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=8, color=colour)
        panel.margins(x=0.25)
        panel.set_xlabel(f"{name}{', ' + unit if (unit := sweep.study.parameters[name].unit) else ''}")
        panel.grid(visible=True, axis="x", color="#dddddd")
        panel.locator_params(axis="x", nbins=6)
    axes[0].set_yticks(range(len(settings)), settings)
    axes[0].set_ylim(len(settings) - 0.5, -0.8)
    figure.suptitle(f"{sweep.study.name}: where success ends", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    return path


def _panel(panel: Axes, sweep: Sweep, name: str) -> None:
    study, parameter = sweep.study, sweep.study.parameters[name]
    settings = [USUAL, *study.settings]
    words = any(isinstance(value, str) for value in parameter.levels())
    for number, setting in enumerate(settings):
        levels = sweep.of(name, setting)
        if not levels:
            continue
        colour = COLOURS[number % len(COLOURS)]
        # A little aside, so that intervals do not lie on one another.
        span = 0.0 if words else float(np.ptp([float(level.value or 0) for level in levels]))
        aside = min(0.012, 0.06 / len(settings)) * span * (number - (len(settings) - 1) / 2)
        x: list[Any] = [str(level.value) if words else float(level.value or 0) + aside for level in levels]
        y, below, above = _bars(levels, shares=study.decisive is not None)
        panel.errorbar(
            x,
            y,
            (below, above),
            fmt=MARKERS[number % len(MARKERS)] + ("-" if number == 0 else "--"),
            color=colour,
            label=setting,
            capsize=2,
            linewidth=1.2,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.4,
        )
        for cliff in sweep.cliffs:
            if (cliff.parameter, cliff.setting) == (name, setting):
                middle = (cliff.low + cliff.high) / 2
                panel.axvline(middle, color=colour, linestyle=":", linewidth=1)
                if len(settings) > _ANNOTATED:
                    continue
                panel.annotate(
                    f"{middle:.4g}",
                    (middle, 0.02),
                    xytext=(2, 9 * number),
                    textcoords="offset points",
                    color=colour,
                    fontsize=8,
                    bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.5},
                )
    panel.set_xlabel(f"{name}{', ' + parameter.unit if parameter.unit else ''}{_how(parameter.how)}")
    unit = (study.decisive or study.all_outcomes[0]).unit
    panel.set_ylabel("share of successes" if study.decisive else f"{measured(study)}{', ' + unit if unit else ''}")
    if study.decisive:
        panel.set_ylim(-0.05, 1.05)
    if not words:
        panel.locator_params(axis="x", nbins=6)
    panel.grid(visible=True, color="#dddddd")
    panel.set_axisbelow(True)


def _how(how: str) -> str:
    return {"set": "", "scale": " (factor)", "add": " (added)"}[how]


def _bars(levels: Sequence[Level], *, shares: bool) -> tuple[list[float], list[float], list[float]]:
    """Values with what is below and above them."""
    if shares:
        y = [level.share for level in levels]
        if all(level.episodes == 1 for level in levels):
            # One trial says nothing of a share: its interval is nearly all there is.
            return y, [0.0] * len(y), [0.0] * len(y)
        return (
            y,
            [a - level.interval[0] for a, level in zip(y, levels, strict=True)],
            [level.interval[1] - a for a, level in zip(y, levels, strict=True)],
        )
    y = [level.mean for level in levels]
    error = [0.0 if math.isnan(level.spread) else level.spread / math.sqrt(level.episodes - level.diverged) for level in levels]
    return y, error, error
