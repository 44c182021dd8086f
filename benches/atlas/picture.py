"""Figure of the atlas: shares of the runs of each engine that hold, fail, are not finite, or are not possible."""

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from atlas.run import CANNOT, HELD, Row

_KINDS = {"holds": "#0b5d3b", "fails": "#e08a72", "not finite": "#1a1a1a", "cannot run": "#d9d9d9"}
"""Colour of each kind of result, in the order of the bars."""


def _kind(row: Row) -> str:
    """Kind of a result."""
    if row.outcome == CANNOT:
        return "cannot run"
    if row.outcome == HELD:
        return "holds"
    return "fails" if math.isfinite(row.error) else "not finite"


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Draw the results of all engines as horizontal bars, and write the figure to a PNG file."""
    engines = list(dict.fromkeys(row.engine for row in rows))
    counts = {engine: [sum(row.engine == engine and _kind(row) == kind for row in rows) for kind in _KINDS] for engine in engines}
    engines.sort(key=lambda engine: counts[engine][0])
    figure = Figure(figsize=(8.0, 1.0 + 0.32 * len(engines)), dpi=110, layout="constrained")
    axes = figure.subplots()
    left = [0.0] * len(engines)
    for k, (kind, colour) in enumerate(_KINDS.items()):
        widths = [100 * counts[engine][k] / sum(counts[engine]) for engine in engines]
        axes.barh(engines, widths, left=left, color=colour, label=kind, height=0.75)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    for y, engine in enumerate(engines):
        share = 100 * counts[engine][0] / sum(counts[engine])
        axes.text(share / 2, y, f"{share:.0f} %", ha="center", va="center", color="white", fontsize=9)
    axes.set_xlim(0, 100)
    axes.set_xlabel("% of all scenes and time steps")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=len(_KINDS), frameon=False, fontsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(path)
