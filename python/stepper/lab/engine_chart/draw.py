"""Picture and table of a chart of a built-in scene."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from stepper.lab.engine_chart.run import Row
from stepper.lab.engine_chart.scenes import Scene
from stepper.shared.files import write_csv as write_csv_file
from stepper.shared.files import write_figure
from stepper.shared.machine import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "h", "p")
COLOURS = {
    "stepper": ["#0b3c8c", "#1f77d0", "#17a2b8", "#2ca02c", "#7a3fb5"],
    "MuJoCo": ["#d62728", "#ff7f0e", "#b8860b", "#8c564b", "#e377c2"],
}
"""Colours of the lines of each engine, by name of the engine."""
OTHERS = ["#333333", "#666666", "#999999"]
"""Colours of the lines of any other engine."""
LEAST_ERROR = 1e-16
"""Smallest error that is drawn."""


def write_csv(path: Path, scene: Scene, rows: Sequence[Row], provenance: Mapping[str, object]) -> None:
    """Writes the points of a chart as rows of a CSV file, after comment lines with the scene and the provenance.

    Args:
        path: CSV file.
        scene: The scene.
        rows: Points of the scene's chart.
        provenance: Command, machine and versions, from `stepper.shared.machine.provenance`.
    """
    notes = {"title": scene.title, "error": scene.error_label, "reference": scene.reference, "duration_s": scene.duration}
    head = {"scene", "engine", "setting"}
    lines = [f"# {key}: {value if isinstance(value, str) else json.dumps(value)}\n" for key, value in {**notes, **provenance}.items()]
    lines.append("# dt in s; cost in microseconds of one core per simulated second of one environment; step in microseconds\n")
    cells = [[v if isinstance(v, str) else f"{v:.6g}" for v in asdict(row).values()] for row in rows]
    write_csv_file(path, [asdict(rows[0]) if rows else head, *cells], "".join(lines))


def _lines(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    """Points of the chart grouped by (engine, settings), one group for each line."""
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        lines.setdefault((row.engine, row.setting), []).append(row)
    return lines


def _colour(engine: str, index: int) -> str:
    """Colour of a line, by engine and index of its setting."""
    palette = COLOURS.get(engine, OTHERS)
    return palette[index % len(palette)]


def _label(points: Sequence[Row]) -> str:
    """Label of a line in the legend, with its order of convergence and the number of diverged runs."""
    first = points[0]
    order = "" if math.isnan(first.slope) else f"  (error ~ dt^{round(first.slope, 1) + 0.0:.1f})"
    lost = sum(not math.isfinite(p.error) for p in points)
    return f"{first.engine}: {first.setting}{order}" + (f"  [{lost} diverged]" if lost else "")


def _plot_lines(axes: Axes, rows: Sequence[Row], markers: Mapping[float, str]) -> None:
    """Draws error against cost, with a line per setting and a marker per time step."""
    seen: dict[str, int] = {}
    for (engine, _), points in _lines(rows).items():
        colour = _colour(engine, seen.get(engine, 0))
        seen[engine] = seen.get(engine, 0) + 1
        good = [p for p in points if math.isfinite(p.error)]
        cost, error = [p.cost for p in good], [max(p.error, LEAST_ERROR) for p in good]
        axes.plot(cost, error, "-" if engine == "stepper" else "--", color=colour, linewidth=1.6, label=_label(points))
        for p, x, y in zip(good, cost, error, strict=True):
            axes.plot(x, y, markers[p.dt], color=colour, markersize=6, markeredgecolor="white", markeredgewidth=0.5)


def _legends(figure: Figure, axes: Axes, markers: Mapping[float, str]) -> None:
    """Adds two legends to the picture of a chart: markers of time steps, and line colours of engines with their settings.

    `markers` has the marker of each time step in s.
    """
    lines = require("matplotlib.lines", "to draw a chart")
    by_dt = [lines.Line2D([], [], marker=mark, color="#444444", linestyle="none", label=f"{dt * 1e3:g} ms") for dt, mark in markers.items()]
    steps = axes.legend(handles=by_dt, title="time step", loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    axes.add_artist(steps)
    handles = _columns(axes.get_lines())
    figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.215), ncols=2, frameon=False, fontsize="small", handlelength=3.0
    )


def _columns(lines: Sequence[Line2D]) -> list[Line2D]:
    """Lines of a chart's legend in the order of two columns, stepper's on the left. Blank entries fill up the shorter column."""
    blank = require("matplotlib.lines", "to draw a chart").Line2D
    named = [line for line in lines if not str(line.get_label()).startswith("_")]
    left = [line for line in named if str(line.get_label()).startswith("stepper")]
    right = [line for line in named if line not in left]
    height = max(len(left), len(right))
    for column in (left, right):
        column.extend(blank([], [], color="none", label=" ") for _ in range(height - len(column)))
    return left + right


def draw(path: Path, scene: Scene, rows: Sequence[Row], note: str = "") -> None:
    """Draws error against cost on logarithmic axes; down and left is better.

    Args:
        path: PNG file.
        scene: The scene.
        rows: Points of the scene's chart.
        note: Line below the title: machine and versions.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    figures = require("matplotlib.figure", "to draw a chart")
    figure = figures.Figure(figsize=(9.0, 6.6), dpi=130)
    axes = figure.add_axes((0.09, 0.29, 0.75, 0.575))
    markers = dict(zip(sorted({row.dt for row in rows}), MARKERS, strict=False))
    _plot_lines(axes, rows, markers)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("microseconds of one core per simulated second of one environment (down and left is better)")
    axes.set_ylabel(scene.error_label)
    axes.grid(visible=True, which="major", color="#dddddd")
    axes.grid(visible=True, which="minor", axis="x", color="#f2f2f2")
    axes.tick_params(which="minor", axis="y", length=0.0)
    axes.set_axisbelow(True)
    figure.text(0.09, 0.955, scene.title, fontsize="large", weight="bold")
    figure.text(0.09, 0.925, f"reference: {scene.reference}", fontsize="small", color="#444444")
    figure.text(0.09, 0.895, note, fontsize="small", color="#444444")
    _legends(figure, axes, markers)
    write_figure(path, figure)
