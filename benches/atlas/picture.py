"""Figure of the atlas: a row for each scene, a column for each engine, time steps within a cell; colour is error over tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from atlas.run import CANNOT, Row

DECADES = 4.0
"""Range of the colour scale on each side of the tolerance, in powers of ten."""
HOLDS, LIMIT_IN, LIMIT_OUT, FAILS = "#0b5d3b", "#bfe5c8", "#ffd9c2", "#a3150f"
COLOURS = LinearSegmentedColormap.from_list("atlas", [(0.0, HOLDS), (0.5, LIMIT_IN), (0.5, LIMIT_OUT), (1.0, FAILS)])
DIVERGED, ABSENT = "#1a1a1a", "#d9d9d9"


def _colour(row: Row) -> str | tuple[float, float, float, float]:
    """Colour of a result in the figure.

    The colour shows the ratio of error to tolerance on a logarithmic scale. Runs that diverged or were not possible have fixed colours.
    """
    if row.outcome == CANNOT:
        return ABSENT
    if not math.isfinite(row.error):
        return DIVERGED
    held = row.error <= row.tolerance
    ratio = math.log10(max(row.error, 1e-300) / row.tolerance) if row.tolerance > 0 else (-DECADES if held else DECADES)
    # Avoid exactly 0, where the colour map jumps.
    value = min(max(ratio / DECADES, -1.0), -1e-3) if held else max(min(ratio / DECADES, 1.0), 1e-3)
    return COLOURS(0.5 + 0.5 * value)


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Draw the results of all scenes, engines and time steps as a figure, and write it to a PNG file."""
    titles = list(dict.fromkeys(f"{r.number}  {r.name}" for r in rows))
    engines = list(dict.fromkeys(r.engine for r in rows))
    figure = Figure(figsize=(5.2 + 1.0 * len(engines), 2.0 + 0.2 * len(titles)), dpi=110)
    axes = figure.add_axes((0.3, 0.03, 0.68, 0.87))
    for row in rows:
        y, x = titles.index(f"{row.number}  {row.name}"), engines.index(row.engine)
        dts = sorted({r.dt for r in rows if (r.number, r.name) == (row.number, row.name)})
        width = 0.92 / len(dts)
        axes.add_patch(_cell(x + 0.04 + dts.index(row.dt) * width, y + 0.06, width, row))
    axes.set_xlim(0, len(engines))
    axes.set_ylim(len(titles), 0)
    axes.set_yticks(np.arange(len(titles)) + 0.5, titles, fontsize=7)
    axes.set_xticks(np.arange(len(engines)) + 0.5, [e.replace(" ", "\n", 1) for e in engines], fontsize=8)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    colours = (HOLDS, LIMIT_IN, LIMIT_OUT, FAILS, DIVERGED, ABSENT)
    labels = ("holds, 4 decades inside", "just holds", "just fails", "fails by 4 decades", "not finite", "cannot run")
    key = [Patch(color=c, label=label) for c, label in zip(colours, labels, strict=True)]
    figure.legend(handles=key, loc="upper left", ncols=2, fontsize=8, frameon=False, title="within a cell: time steps, small to large")
    figure.savefig(path)


def _cell(x: float, y: float, width: float, row: Row) -> Rectangle:
    """Rectangle of a cell of the figure.

    Args:
        x: Left end.
        y: Upper end; y points down in the figure.
        width: Width.
        row: Result whose ratio of error to tolerance gives the colour.
    """
    return Rectangle((x, y), width, 0.88, facecolor=_colour(row), linewidth=0)
