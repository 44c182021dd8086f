"""Generated terrain of square tiles: one row per level of difficulty, one column per kind of terrain."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

import numpy as np

from stepper.envs.task import Array
from stepper.envs.terrain.sub_terrains import SubTerrain
from stepper.sensors import HeightField
from stepper.shared.arguments import check_number, check_pair, check_whole

if TYPE_CHECKING:
    import mujoco

_CELL_TOLERANCE = 1e-6
"""Largest accepted deviation of a number of grid cells from a whole number."""
_MIN_EXTENT = 1e-3
"""Least extent in z of a height field, m: MuJoCo refuses 0, the extent of flat ground."""
_BASE_THICKNESS = 0.5
"""Thickness of the ground below its lowest point, m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Terrain:
    """Terrain of square tiles. Difficulty increases from row to row along x; each column along y has one kind. The middle is at the origin.

        ground = Terrain(sub_terrains={"rough": RandomRough(), "stairs": PyramidStairs()}, seed=1)
        ground.add_to(spec)  # a height field "terrain" in a mujoco.MjSpec
        ground.origins  # (num_rows, 2, 3) m, middles of the tiles on the surface

    Equal arguments give equal terrains. Two terrains are equal if they have the same heights, tiles, and names and proportions of kinds.
    The random numbers of a tile depend only on the seed of the terrain, and on the row and column of the tile.

    Attributes:
        sub_terrains: Kinds of terrain by name, one column each.
        num_rows: Number of rows, that is levels of difficulty.
        size: Side of a tile, m.
        horizontal_scale: Distance between grid points of the height field, m. A vertical step becomes a ramp of this length.
        border_width: Width of the flat ground around all tiles, m.
        difficulty_range: Difficulty of the first and of the last row, from 0 to 1.
        seed: Seed of all random numbers of the terrain.

    Raises:
        TypeError: An argument has another type.
        ValueError: There are no kinds, a number is out of its range, or `size` or `border_width` is not a whole number of grid cells.
    """

    sub_terrains: Mapping[str, SubTerrain]
    num_rows: int = 10
    size: float = 8.0
    horizontal_scale: float = 0.1
    border_width: float = 2.0
    difficulty_range: tuple[float, float] = (0.0, 1.0)
    seed: int = 0

    def __post_init__(self) -> None:
        kinds = self.sub_terrains
        if not isinstance(kinds, Mapping) or not all(isinstance(kind, SubTerrain) for kind in kinds.values()):
            raise TypeError(f'sub_terrains is {kinds!r}, must be a mapping from names to kinds of terrain, such as {{"flat": Flat()}}')
        check_whole("num_rows", self.num_rows, least=1)
        check_whole("seed", self.seed, least=0)
        if not kinds:
            raise ValueError('sub_terrains is empty, must have at least one kind of terrain, such as {"flat": Flat()}')
        check_number("horizontal_scale", self.horizontal_scale, above=0.0)
        for name in ("size", "border_width"):
            check_number(name, getattr(self, name), least=0.0)
            cells = getattr(self, name) / self.horizontal_scale
            if abs(cells - round(cells)) > _CELL_TOLERANCE or round(cells) < (1 if name == "size" else 0):
                raise ValueError(f"{name} is {getattr(self, name)} m, must be a whole number of cells of {self.horizontal_scale} m")
        check_pair("difficulty_range", self.difficulty_range, meaning="from 0 to 1, the easier one first")
        if not 0.0 <= self.difficulty_range[0] <= self.difficulty_range[1] <= 1.0:
            raise ValueError(f"difficulty_range is {self.difficulty_range}, must be two numbers from 0 to 1, the easier one first")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Terrain) and self._digest == other._digest

    def __hash__(self) -> int:
        return hash(self._digest)

    @functools.cached_property
    def _digest(self) -> str:
        """Hash of heights, tiles, and names and proportions of kinds; terrains with equal hashes are equal.

        The arguments themselves cannot be compared, because a kind may have attributes of any type.
        """
        names = [(name, kind.proportion) for name, kind in self.sub_terrains.items()]
        text = repr((names, self.num_rows, self.size, self.horizontal_scale, self.border_width))
        return hashlib.sha256(text.encode() + np.ascontiguousarray(self.elevation).tobytes()).hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        # A pickle has no heights: its reader computes them from the arguments.
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def difficulties(self) -> Array:
        """Difficulty of each row, (num_rows,), from 0 to 1."""
        return np.linspace(*self.difficulty_range, self.num_rows)

    @property
    def proportions(self) -> Array:
        """Fraction of the environments on each kind of terrain, (num_columns,); the sum is 1."""
        shares = np.array([kind.proportion for kind in self.sub_terrains.values()])
        normalised: Array = shares / shares.sum()
        return normalised

    @property
    def half(self) -> Array:
        """Half the extent of the terrain in x and y, including the border, (2,), m."""
        half: Array = 0.5 * self.size * np.array([self.num_rows, len(self.sub_terrains)]) + self.border_width
        return half

    @functools.cached_property
    def elevation(self) -> Array:
        """Heights of the grid points, (rows, columns), m: rows along y, columns along x.

        The heights are rounded as in MuJoCo's height fields, which store relative heights in single precision.
        """
        border, cells = round(self.border_width / self.horizontal_scale), round(self.size / self.horizontal_scale)
        shape = [2 * border + cells * count + 1 for count in (len(self.sub_terrains), self.num_rows)]
        heights = np.zeros(shape)
        for row in range(self.num_rows):
            for column in range(len(self.sub_terrains)):
                first, second = border + cells * column, border + cells * row
                heights[first : first + cells + 1, second : second + cells + 1] += self._tile(row, column)
        lowest, extent = heights.min(), max(float(np.ptp(heights)), _MIN_EXTENT)
        single = ((heights - lowest) / extent).astype(np.float32)
        elevation: Array = single.astype(np.float64) * extent + lowest
        return elevation

    @functools.cached_property
    def ground(self) -> HeightField:
        """Height field from which heights can be read without a simulation."""
        return HeightField.from_elevation(self.elevation, self.half)

    @functools.cached_property
    def origins(self) -> Array:
        """Middles of the tiles on the surface, (num_rows, num_columns, 3) m."""
        x, y = (self.size * (np.arange(count) - (count - 1) / 2) for count in (self.num_rows, len(self.sub_terrains)))
        places = np.stack(np.broadcast_arrays(x[:, None], y), axis=-1)
        return np.concatenate([places, self.height(places)[..., None]], axis=-1)

    def height(self, xy: Array) -> Array:
        """Returns the heights of the terrain's surface, m, at points (..., 2), m; 0 outside the terrain."""
        return self.ground.heights(None, xy, beyond=0.0)

    def leaves(self, xy: Array, margin: float = 0.3) -> Array:
        """Whether points (..., 2) m are outside the terrain or within `margin` m of its outer edge, (...) bool; for `Task.truncated`."""
        return np.asarray(np.any(np.abs(xy) > self.half - margin, axis=-1))

    def add_to(self, spec: mujoco.MjSpec, name: str = "terrain", **attributes: Any) -> None:
        """Adds the terrain to a MuJoCo scene, which `stepper.load(spec.compile())` reads.

        Args:
            spec: The scene, which is changed in place.
            name: Name of the height field and of its geom.
            **attributes: Attributes of the geom, such as friction, rgba or contype.
        """
        import mujoco  # noqa: PLC0415 - an optional package

        data, lowest, size = self._field()
        spec.add_hfield(name=name, nrow=len(data), ncol=data.shape[1], size=size, userdata=data.ravel())
        kind = mujoco.mjtGeom.mjGEOM_HFIELD
        spec.worldbody.add_geom(name=name, type=kind, hfieldname=name, pos=[0.0, 0.0, lowest], **attributes)

    def elements(self, name: str = "terrain", **attributes: str) -> tuple[Element, Element]:
        """Returns the MJCF elements of the height field: the asset, and the geom with the given attributes."""
        data, lowest, size = self._field()
        # MJCF has rows from the greatest y to the least. Nine digits determine a number of single precision.
        values = " ".join(f"{value:.9g}" for value in data[::-1].ravel().tolist())
        shape = {"nrow": str(len(data)), "ncol": str(data.shape[1]), "size": " ".join(map(repr, size))}
        asset = Element("hfield", {"name": name, "elevation": values, **shape})
        place = {"name": name, "type": "hfield", "hfield": name, "pos": f"0 0 {lowest!r}"}
        return asset, Element("geom", place | attributes)

    def _field(self) -> tuple[Array, float, list[float]]:
        """MuJoCo's data of the height field: relative heights (0 to 1, float32), z of relative height 0 (m), and attribute `size` (4,)."""
        lowest, extent = float(self.elevation.min()), max(float(np.ptp(self.elevation)), _MIN_EXTENT)
        data = ((self.elevation - lowest) / extent).astype(np.float32)
        return data, lowest, [*self.half.tolist(), extent, _BASE_THICKNESS]

    def _tile(self, row: int, column: int) -> Array:
        """Heights of the grid points of a tile, (cells + 1, cells + 1) m; 0 on its border."""
        kind = list(self.sub_terrains.values())[column]
        line = np.linspace(-self.size / 2, self.size / 2, round(self.size / self.horizontal_scale) + 1)
        heights = np.asarray(kind.heights(line, line, self.size, float(self.difficulties[row]), self._rng(row, column)))
        if heights.shape != (len(line), len(line)) or not np.isfinite(heights).all():
            name = list(self.sub_terrains)[column]
            raise ValueError(
                f"heights of sub_terrain {name!r} ({type(kind).__name__}) in row {row} have shape {heights.shape} or are not finite, "
                f"must be {len(line)} x {len(line)} numbers"
            )
        inside = np.abs(line) <= self.size / 2 - max(kind.border_width, self.horizontal_scale / 2) + _CELL_TOLERANCE
        return np.where(inside & inside[:, None], heights, 0.0)

    def _rng(self, row: int, column: int) -> np.random.Generator:
        """Random number generator of the tile in the given row and column of the terrain."""
        return np.random.default_rng([self.seed, row, column])
