"""Bumpy ground: a height field of smooth bumps. All environments share it, and start at different positions on it."""

from __future__ import annotations

from functools import cache
from xml.etree.ElementTree import Element

import numpy as np

from stepper.envs.task import Array

HALF = 20.0
"""Half the side of the square height field, m. Around the field, the ground is flat."""
_BUMPS, _FINER = 40, 4
"""Number of bumps along a side, and grid points of the height field per bump."""
_SEED = 17
"""Seed of the random heights."""


@cache
def _heights() -> Array:
    """Relative heights, 0 to 1, at the grid points of the field, (161, 161); rows from the lowest y, columns from the lowest x."""
    coarse = np.random.default_rng(_SEED).uniform(0.0, 1.0, (_BUMPS + 1, _BUMPS + 1))
    at = np.linspace(0.0, _BUMPS, _BUMPS * _FINER + 1)
    below = np.minimum(at.astype(np.int64), _BUMPS - 1)
    share = at - below
    # Bumps are smooth: the slope is zero at each of the coarse points.
    share = share * share * (3.0 - 2.0 * share)
    rows = coarse[below] + share[:, None] * (coarse[below + 1] - coarse[below])
    heights: Array = rows[:, below] + share * (rows[:, below + 1] - rows[:, below])
    heights -= heights.min()
    heights /= heights.max()
    return heights


def height(xy: Array) -> Array:
    """Relative height (0 to 1, bilinear between grid points) of the ground at points (..., 2), m; 0 outside the field."""
    heights = _heights()
    last = len(heights) - 1
    at = (np.asarray(xy, dtype=np.float64) + HALF) * (last / (2.0 * HALF))
    corner = np.clip(np.floor(at).astype(np.int64), 0, last - 1)
    (x, y), (i, j) = np.moveaxis(np.clip(at - corner, 0.0, 1.0), -1, 0), np.moveaxis(corner, -1, 0)
    near = heights[j, i] * (1.0 - x) + heights[j, i + 1] * x
    far = heights[j + 1, i] * (1.0 - x) + heights[j + 1, i + 1] * x
    beside = np.abs(xy).max(axis=-1) > HALF
    return np.where(beside, 0.0, near * (1.0 - y) + far * y)


def elements(greatest: float, attributes: dict[str, str]) -> tuple[Element, Element]:
    """MJCF elements of the height field: its asset and its geom.

    Args:
        greatest: Height of the highest bump, m.
        attributes: Further attributes of the geom.
    """
    heights = _heights()
    # MJCF lists the rows of a height field from the greatest y to the least.
    values = " ".join(f"{value:.6g}" for value in heights[::-1].ravel())
    sizes = {"nrow": str(len(heights)), "ncol": str(heights.shape[1]), "size": f"{HALF!r} {HALF!r} {greatest!r} 0.1"}
    field = Element("hfield", {"name": "terrain", "elevation": values, **sizes})
    return field, Element("geom", {"name": "terrain", "type": "hfield", "hfield": "terrain", **attributes})
