"""Kinds of terrain: heights of a square tile as a function of the difficulty. The edge of a tile has height 0, so that tiles fit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array
from stepper.shared.arguments import check_number, check_pair, check_whole

Range = tuple[float, float]
"""Pair of values of a parameter: at difficulty 0 and at difficulty 1. Values between are interpolated linearly."""

_EDGE_MARGIN = 1e-9
"""Distance from an edge, m, within which grid points count as on the edge, whatever their rounding errors."""


@dataclass(frozen=True, kw_only=True)
class SubTerrain(ABC):
    """Kind of terrain of a square tile. Episodes start in the middle of the tile, and the border of the tile has height 0. Abstract.

    Attributes of type `Range` are pairs: the value at difficulty 0, and the value at difficulty 1.

    Attributes:
        proportion: Relative number of environments on tiles of this kind; `Terrain.proportions` normalises it.
        border_width: Width of the flat border, m.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("proportion", "border_width")
    """Attributes that must be numbers, or pairs of numbers, of at least 0."""
    _above_0: ClassVar[tuple[str, ...]] = ()
    """Attributes that must be numbers above 0."""

    proportion: float = 1.0
    border_width: float = 0.25

    def __post_init__(self) -> None:
        for field in fields(self):
            value, default, name = getattr(self, field.name), field.default, f"{field.name} of {type(self).__name__}"
            least = 0.0 if field.name in (*SubTerrain._at_least_0, *self._at_least_0) else -math.inf
            if isinstance(default, tuple) and len(default) == 2:
                check_pair(name, value, meaning=f"such as {default}")
                for number in value:
                    check_number(name, number, least=least)
            elif isinstance(default, int) and not isinstance(default, bool):
                check_whole(name, value, least=least)
            elif isinstance(default, float):
                check_number(name, value, least=least, above=0.0 if field.name in self._above_0 else -math.inf)

    @abstractmethod
    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights at points of a tile.

        Args:
            x: x coordinates relative to the middle of the tile, (nx,), m, ascending.
            y: y coordinates relative to the middle of the tile, (ny,), m, ascending.
            size: Side of the tile, m.
            difficulty: From 0, easiest, to 1, hardest.
            rng: Random number generator of this tile.

        Returns:
            Heights, (ny, nx), m. `Terrain` sets those on the border to 0.
        """


@dataclass(frozen=True, kw_only=True)
class Flat(SubTerrain):
    """Flat ground at any difficulty."""

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns heights of 0, (ny, nx), m."""
        return np.zeros((len(y), len(x)))


@dataclass(frozen=True, kw_only=True)
class RandomRough(SubTerrain):
    """Rough ground: random heights at the points of a coarse grid, with bilinear interpolation.

    Attributes:
        height_range: Largest random height at difficulty 0 and at difficulty 1, m. The smallest height is 0.
        spacing: Distance between points of the coarse grid, m.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("height_range",)
    _above_0: ClassVar[tuple[str, ...]] = ("spacing",)

    height_range: Range = (0.0, 0.1)
    spacing: float = 0.2

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights, (ny, nx), m: uniformly distributed from 0 to the largest height at the points of the coarse grid."""
        points = np.linspace(-size / 2, size / 2, max(2, round(size / self.spacing) + 1))
        drawn = rng.uniform(0.0, _at(self.height_range, difficulty), (len(points), len(points)))
        along = np.stack([np.interp(x, points, row) for row in drawn])
        return np.stack([np.interp(y, points, column) for column in along.T], axis=1)


@dataclass(frozen=True, kw_only=True)
class PyramidSlope(SubTerrain):
    """Slopes to a platform in the middle.

    Attributes:
        slope_range: Slope (rise over run) at difficulty 0 and at difficulty 1.
        platform_width: Side of the platform, m.
        inverted: Whether slopes go down to the middle.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("platform_width",)

    slope_range: Range = (0.0, 0.7)
    platform_width: float = 2.0
    inverted: bool = False

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights, (ny, nx), m, which rise from the border to the platform, or fall if `inverted`."""
        distance = size / 2 - self.border_width - _from_middle(x, y)
        rise = np.clip(distance, 0.0, max(0.0, (size - self.platform_width) / 2 - self.border_width))
        return (-1.0 if self.inverted else 1.0) * _at(self.slope_range, difficulty) * rise


@dataclass(frozen=True, kw_only=True)
class Wave(SubTerrain):
    """Hills and hollows in a regular pattern.

    Attributes:
        amplitude_range: Height of the hills, equal to the depth of the hollows, at difficulty 0 and at difficulty 1, m.
        num_waves: Number of waves along each side.
    """

    amplitude_range: Range = (0.0, 0.2)
    num_waves: int = 4

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights, (ny, nx), m: a product of sines along x and y, which is zero on the edge of the tile."""
        along, across = (np.sin(2.0 * np.pi * self.num_waves * (places / size + 0.5)) for places in (x, y))
        return _at(self.amplitude_range, difficulty) * across[:, None] * along


@dataclass(frozen=True, kw_only=True)
class PyramidStairs(SubTerrain):
    """Stairs to a platform in the middle.

    Attributes:
        step_height_range: Height of a step at difficulty 0 and at difficulty 1, m.
        step_width: Depth of a tread, m.
        platform_width: Smallest side of the platform, m.
        inverted: Whether stairs go down to the middle.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("platform_width",)
    _above_0: ClassVar[tuple[str, ...]] = ("step_width",)

    border_width: float = 1.0
    step_height_range: Range = (0.0, 0.2)
    step_width: float = 0.3
    platform_width: float = 3.0
    inverted: bool = False

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights, (ny, nx), m, of concentric squares: each is a step higher than that around it, or lower if `inverted`."""
        step, outer = _at(self.step_height_range, difficulty), size / 2 - self.border_width
        count = max(0, int((outer - self.platform_width / 2) / self.step_width + _EDGE_MARGIN))
        halves, distance = outer - self.step_width * np.arange(count), _from_middle(x, y)[..., None]
        # A grid point on an edge has the height of the higher step.
        inside = distance < halves - _EDGE_MARGIN if self.inverted else distance < halves + _EDGE_MARGIN
        heights: Array = (-step if self.inverted else step) * inside.sum(axis=-1)
        return heights


def _at(values: Range, difficulty: float) -> float:
    """Value of a terrain parameter at a difficulty from 0 to 1; `values` are those at 0 and 1."""
    return values[0] + difficulty * (values[1] - values[0])


def _from_middle(x: Array, y: Array) -> Array:
    """Chebyshev distance max(|x|, |y|) of grid points from the middle of a tile, (ny, nx), m, for x (nx,) and y (ny,)."""
    distance: Array = np.maximum(np.abs(x), np.abs(y)[:, None])
    return distance
