"""Pictures of a sweep: success rates and outcomes against each parameter, and the values at which success ends (cliffs)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepper.lab.study.batches import USUAL
from stepper.lab.study.document import counted
from stepper.lab.study.sweep import Level, Sweep, ordered_outcomes
from stepper.shared.files import write_figure
from stepper.shared.machine import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stepper.lab.study.outcomes import Outcome

COLOURS = (
    *("#0b3c8c", "#1f9e77", "#7a3fb5", "#d62728", "#ff7f0e", "#8c564b", "#17a2b8", "#666666"),
    *("#e377c2", "#bcbd22", "#000000", "#9ecae1"),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "h", "p")
WIDEST = 1400
"""Largest width of a picture, pixels: the width of a page."""
DPI = 130
_COLUMNS = 3
_LABEL = 44
"""Number of characters after which a label of the legend is wrapped."""


def draw(sweep: Sweep, path: Path) -> Path:
    """Draws a sweep into a PNG file: success rates and means of all outcomes against each parameter. Returns the path.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    return write_figure(path, figure_of(sweep))


def figure_of(sweep: Sweep) -> Any:
    """Figure of a sweep: per parameter, success rates with Wilson intervals, and below them means of all outcomes with standard errors.

    Values of a bisection are drawn without intervals, so that the curve shows where success ends.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    figures = require("matplotlib.figure", "to draw a sweep")
    names = [name for name in sweep.study.parameters if any(level.parameter == name for level in sweep.levels)]
    kinds = [*([None] if sweep.study.success_outcome else []), *ordered_outcomes(sweep.study)]
    columns = min(_COLUMNS, max(1, len(names)))
    lines = max(1, math.ceil(len(names) / columns))
    labels = [_wrapped(name) for name in (USUAL, *sweep.study.settings)]
    width = max(7.5, 3.5 * columns)
    each = _legend_columns(labels, width)
    beneath = 0.9 + 0.22 * sum(max(label.count("\n") + 1 for label in labels[k : k + each]) for k in range(0, len(labels), each))
    figure = figures.Figure(figsize=(width, (0.8 + 1.9 * len(kinds)) * lines + beneath), dpi=DPI, layout="constrained")
    axes = figure.subplots(lines * len(kinds), columns, squeeze=False)
    for k in range(lines * columns):
        for part, outcome in enumerate(kinds):
            panel = axes[k // columns * len(kinds) + part, k % columns]
            if k < len(names):
                _panel(panel, sweep, names[k], outcome)
            else:
                panel.set_visible(False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if len(labels) > 1:
        if any(cliff.parameter in names for cliff in sweep.cliffs):
            handles.append(_line(color="#444444", linestyle=":", linewidth=1))
            labels.append("where success ends")
        if sweep.study.success_outcome:
            handles.append(_line(color="#444444", linestyle="-.", linewidth=1))
            labels.append("limit of success")
        figure.legend(handles, labels, loc="outside lower center", ncols=min(each, len(labels)), frameon=False, fontsize=9)
    outcomes = ", ".join(outcome.name for outcome in ordered_outcomes(sweep.study))
    title = f"{sweep.study.name}: {outcomes}, {counted(sweep.study.episodes, 'episode')} a point"
    figure.suptitle(textwrap.fill(title, int(11 * width)), fontsize=11)
    return figure


def _panel(panel: Axes, sweep: Sweep, name: str, outcome: Outcome | None) -> None:
    """Draws the panel of a parameter: means of an outcome, or success rates."""
    study, parameter = sweep.study, sweep.study.parameters[name]
    settings = [USUAL, *study.settings]
    words = any(isinstance(value, str) for value in parameter.levels())
    for number, setting in enumerate(settings):
        if sweep.levels_of(name, setting):
            _series(panel, sweep, name, number, outcome)
        for cliff in sweep.cliffs:
            if (cliff.parameter, cliff.setting) == (name, setting):
                panel.axvline((cliff.low + cliff.high) / 2, color=COLOURS[number % len(COLOURS)], linestyle=":", linewidth=1)
    panel.set_xlabel(_axis_label(sweep, name) + {"set": "", "scale": " (factor)", "add": " (added)"}[parameter.operation])
    if outcome is None:
        panel.set_ylabel("fraction of successes")
        panel.set_ylim(-0.05, 1.05)
    else:
        panel.set_ylabel(f"{outcome.name}{', ' + outcome.unit if outcome.unit else ''}")
        if outcome.threshold is not None:
            panel.axhline(outcome.threshold, color="#444444", linestyle="-.", linewidth=1)
    if not words:
        panel.locator_params(axis="x", nbins=6)
    panel.grid(visible=True, color="#dddddd")
    panel.set_axisbelow(True)


def _series(panel: Axes, sweep: Sweep, name: str, number: int, outcome: Outcome | None) -> None:
    """Draws success rates or means of an outcome for one of the settings. Markers of later settings are smaller, so all are visible."""
    settings = [USUAL, *sweep.study.settings]
    setting, colour = settings[number], COLOURS[number % len(COLOURS)]
    points, levels = sweep.points(name, setting), sweep.levels_of(name, setting)
    line = panel.plot(
        _axis_values(points),
        _bars(points, outcome)[0],
        "-" if number == 0 else "--",
        color=colour,
        linewidth=1.2,
        marker=".",
        markersize=3,
    )[0]
    line.set_gid(f"{name}/{setting}")
    y, below, above = _bars(levels, outcome)
    panel.errorbar(
        _axis_values(levels), y, (below, above), fmt=MARKERS[number % len(MARKERS)], color=colour, label=_wrapped(setting), capsize=2,
        markersize=9 - 5 * number / max(1, len(settings) - 1), markerfacecolor="none", linewidth=1,
    )  # fmt: skip


def _axis_values(levels: Sequence[Level]) -> list[Any]:
    """Values of a parameter for an axis of Matplotlib: texts or numbers."""
    return [level.value if isinstance(level.value, str) else float(level.value or 0) for level in levels]


def _axis_label(sweep: Sweep, name: str) -> str:
    """Name of a parameter with its unit, wrapped to the width of a panel."""
    unit = sweep.study.parameters[name].unit
    return textwrap.fill(f"{name}{', ' + unit if unit else ''}", 36)


def _wrapped(setting: str) -> str:
    """Name of settings, wrapped to the width of the legend."""
    return textwrap.fill(setting, _LABEL)


def _legend_columns(labels: Sequence[str], width: float) -> int:
    """Number of columns of a legend that fit into a picture. A character needs 0.08 inches, a marker with its margin 0.7 inches."""
    longest = max(len(line) for label in (*labels, "where success ends") for line in label.split("\n"))
    return max(1, min(4, int(width / (0.08 * longest + 0.7))))


def _line(**style: Any) -> Any:
    """Line of Matplotlib without points, for a legend, with the given style."""
    return require("matplotlib.lines", "to draw a sweep").Line2D([], [], **style)


def _bars(levels: Sequence[Level], outcome: Outcome | None) -> tuple[list[float], list[float], list[float]]:
    """Heights of the points in a panel of a sweep, and lengths of their error bars below and above."""
    if outcome is None:
        y = [level.share for level in levels]
        if all(level.episodes == 1 for level in levels):
            # The interval of a single trial spans nearly the whole axis.
            return y, [0.0] * len(y), [0.0] * len(y)
        return (
            y,
            [a - level.interval[0] for a, level in zip(y, levels, strict=True)],
            [level.interval[1] - a for a, level in zip(y, levels, strict=True)],
        )
    found = [level.of(outcome.name) for level in levels]
    error = [
        0.0 if math.isnan(own.spread) else own.spread / math.sqrt(level.episodes - level.diverged)
        for own, level in zip(found, levels, strict=True)
    ]
    return [own.mean for own in found], error, error
