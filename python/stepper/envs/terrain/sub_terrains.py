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
"""Margin around a box, m, within which grid points count as on the box, so that rounding errors exclude no point on its edge."""
_THICKNESS = 0.5
"""Thickness of the ground below its lowest point, m."""


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


class BoxTerrain(SubTerrain):
    """Kind of terrain that consists of boxes. A scene can contain it as a height field, or as box geoms with vertical walls. Abstract."""

    @abstractmethod
    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns boxes that cover a tile, (n, 2, 3), m: lowest and highest corner of each, relative to the middle of the tile.

        Args:
            size: Side of the tile, m.
            difficulty: From 0, easiest, to 1, hardest.
            rng: Random number generator of this tile.
        """

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights of the tops of the highest boxes at points of a tile, (ny, nx), m; see `SubTerrain.heights`."""
        heights = np.full((len(y), len(x)), -np.inf)
        for (x_low, y_low, _), (x_high, y_high, top) in self.boxes(size, difficulty, rng):
            columns = slice(np.searchsorted(x, x_low - _EDGE_MARGIN), np.searchsorted(x, x_high + _EDGE_MARGIN))
            rows = slice(np.searchsorted(y, y_low - _EDGE_MARGIN), np.searchsorted(y, y_high + _EDGE_MARGIN))
            heights[rows, columns] = np.maximum(heights[rows, columns], top)
        return heights


@dataclass(frozen=True, kw_only=True)
class Flat(BoxTerrain):
    """Flat ground at any difficulty."""

    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the box of the flat ground of a tile, (1, 2, 3), m: lowest and highest corner."""
        return np.array([_box(-size / 2, size / 2, -size / 2, size / 2, -_THICKNESS, 0.0)])


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
class PyramidStairs(BoxTerrain):
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

    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the boxes of border and stairs, (n, 2, 3), m: lowest and highest corner of each.

        Steps are concentric boxes; smaller boxes are higher. Each step of inverted stairs is four boxes around the platform.
        """
        step, outer = _at(self.step_height_range, difficulty), size / 2 - self.border_width
        count = max(0, int((outer - self.platform_width / 2) / self.step_width + _EDGE_MARGIN))
        halves = outer - self.step_width * np.arange(count + 1)
        if not self.inverted:
            pyramid = [_box(-half, half, -half, half, -_THICKNESS, step * (k + 1)) for k, half in enumerate(halves[:count])]
            return np.array([_box(-size / 2, size / 2, -size / 2, size / 2, -_THICKNESS, 0.0), *pyramid])
        bottom = -step * count - _THICKNESS
        rings = [_ring(size / 2, halves[0], bottom, 0.0)]
        rings += [_ring(halves[k], halves[k + 1], bottom, -step * (k + 1)) for k in range(count)]
        last = halves[count]
        return np.concatenate([*rings, [_box(-last, last, -last, last, bottom, -step * count)]])


@dataclass(frozen=True, kw_only=True)
class Gap(BoxTerrain):
    """Gap around a platform in the middle.

    Attributes:
        gap_width_range: Width of the gap at difficulty 0 and at difficulty 1, m, along x and y.
        platform_width: Side of the platform, m.
        depth: Depth of the gap, m.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("gap_width_range", "platform_width", "depth")

    gap_width_range: Range = (0.05, 0.6)
    platform_width: float = 2.0
    depth: float = 1.0

    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the boxes of the platform, the ground around the gap and its bottom, (n, 2, 3), m: lowest and highest corner of each."""
        inner, bottom = self.platform_width / 2, -self.depth - _THICKNESS
        outer = inner + _at(self.gap_width_range, difficulty)
        middle = [_box(-inner, inner, -inner, inner, bottom, 0.0), _box(-outer, outer, -outer, outer, bottom, -self.depth)]
        return np.concatenate([_ring(size / 2, outer, bottom, 0.0), middle])


@dataclass(frozen=True, kw_only=True)
class SteppingStones(BoxTerrain):
    """Stones over a pit, around a platform in the middle.

    Attributes:
        stone_size_range: Side of a stone at difficulty 0 and at difficulty 1, m.
        stone_distance_range: Smallest gap between stones at difficulty 0 and at difficulty 1, m.
        height_variation: Largest height of a stone's top above or below 0, m.
        platform_width: Side of the platform, m.
        depth: Depth of the pit, m.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("stone_size_range", "stone_distance_range", "height_variation", "platform_width", "depth")

    stone_size_range: Range = (0.8, 0.3)
    stone_distance_range: Range = (0.05, 0.3)
    height_variation: float = 0.0
    platform_width: float = 1.0
    depth: float = 1.0

    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the boxes of stones, platform, border and bottom of the pit, (n, 2, 3), m: lowest and highest corner of each."""
        side, distance = _at(self.stone_size_range, difficulty), _at(self.stone_distance_range, difficulty)
        outer, inner, bottom = size / 2 - self.border_width, self.platform_width / 2, -self.depth - _THICKNESS
        count = max(1, int((2.0 * outer - distance) / (side + distance) + _EDGE_MARGIN))
        # The gaps between the stones and at the outer edge are equal.
        gap = (2.0 * outer - count * side) / (count + 1)
        starts = -outer + gap + (side + gap) * np.arange(count)
        tops = rng.uniform(-self.height_variation, self.height_variation, (count, count))
        stones = [_box(x, x + side, y, y + side, bottom, tops[i, j]) for i, x in enumerate(starts) for j, y in enumerate(starts)]
        pit, platform = _box(-outer, outer, -outer, outer, bottom, -self.depth), _box(-inner, inner, -inner, inner, bottom, 0.0)
        return np.concatenate([_ring(size / 2, outer, bottom, 0.0), [pit, platform], stones])


@dataclass(frozen=True, kw_only=True)
class DiscreteObstacles(BoxTerrain):
    """Boxes on flat ground, around a free square in the middle.

    Attributes:
        height_range: Largest height of a box at difficulty 0 and at difficulty 1, m. Heights are uniformly distributed from half the
            largest height to the largest height.
        width_range: Smallest and largest side of a box, m, for any difficulty.
        num_obstacles: Number of boxes; those that would reach into the free square are left out.
        platform_width: Side of the free square, m.
    """

    _at_least_0: ClassVar[tuple[str, ...]] = ("width_range", "num_obstacles", "platform_width")

    height_range: Range = (0.02, 0.2)
    width_range: tuple[float, float] = (0.3, 1.0)
    num_obstacles: int = 40
    platform_width: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width_range[0] > self.width_range[1]:
            raise ValueError(f"width_range of DiscreteObstacles is {self.width_range}, must be two widths, the smaller one first")

    def boxes(self, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the boxes of the ground and of the obstacles on it, (n, 2, 3), m: lowest and highest corner of each."""
        outer = size / 2 - self.border_width
        sides = np.minimum(rng.uniform(*self.width_range, (self.num_obstacles, 2)), 2.0 * outer)
        low = -outer + rng.uniform(0.0, 1.0, (self.num_obstacles, 2)) * (2.0 * outer - sides)
        tops = rng.uniform(0.5, 1.0, self.num_obstacles) * _at(self.height_range, difficulty)
        free = np.any((low > self.platform_width / 2) | (low + sides < -self.platform_width / 2), axis=1)
        parts = zip(low[free], (low + sides)[free], tops[free], strict=True)
        obstacles = [_box(x, x_high, y, y_high, -_THICKNESS, top) for (x, y), (x_high, y_high), top in parts]
        return np.array([_box(-size / 2, size / 2, -size / 2, size / 2, -_THICKNESS, 0.0), *obstacles])


def _at(values: Range, difficulty: float) -> float:
    """Value of a terrain parameter at a difficulty from 0 to 1; `values` are those at 0 and 1."""
    return values[0] + difficulty * (values[1] - values[0])


def _from_middle(x: Array, y: Array) -> Array:
    """Chebyshev distance max(|x|, |y|) of grid points from the middle of a tile, (ny, nx), m, for x (nx,) and y (ny,)."""
    distance: Array = np.maximum(np.abs(x), np.abs(y)[:, None])
    return distance


def _box(*bounds: float) -> list[list[float]]:
    """Lowest and highest corner of a box from its bounds x_low, x_high, y_low, y_high, z_low, z_high."""
    return [list(bounds[::2]), list(bounds[1::2])]


def _ring(outer: float, inner: float, bottom: float, top: float) -> Array:
    """Four boxes that form a square ring with outer and inner half sides, (4, 2, 3) m: lowest and highest corner of each."""
    sides = [(-outer, outer, -outer, -inner), (-outer, outer, inner, outer), (-outer, -inner, -inner, inner), (inner, outer, -inner, inner)]
    return np.array([_box(*side, bottom, top) for side in sides])
