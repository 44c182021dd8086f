"""Heights of a height field at given points, for observations of the terrain."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper._quantities import headings
from stepper._stepper import Model, Stepper
from stepper.loading.load import compile_source
from stepper.loading.origins import Origin, origin_of

Array = NDArray[Any]

_CHUNK = 16384
"""Number of points that are computed together, so that intermediate arrays stay in a core's cache.

Half and twice this number are equally fast.
"""


class HeightGrid:
    """Heights of a surface over a rectangle centred at the origin: a grid of heights with linear interpolation between its points.

    Each cell is two triangles, split by the diagonal from its corner with the smallest x and y.

    Args:
        top: Heights of the grid points, (rows, columns), m: rows along y, columns along x, from the corner with the smallest x and y.
        half: Half the extent in x and y, (2,), m.
    """

    def __init__(self, top: Array, half: Array):
        self.top, self.half = top, half
        rows, columns = top.shape
        self._cells = np.array([columns - 1, rows - 1])
        self._scale = self._cells / (2.0 * half)
        # Per cell: height at the corner with the smallest x and y, and slopes along x and y of its two triangles (upper ones first).
        least, right, above, far = top[:-1, :-1], top[:-1, 1:], top[1:, :-1], top[1:, 1:]
        self._least = np.ascontiguousarray(least).ravel()
        self._along = np.concatenate([(far - above).ravel(), (right - least).ravel()])
        self._across = np.concatenate([(above - least).ravel(), (far - right).ravel()])

    def at(self, places: Array, out: Array) -> None:
        """Writes heights, m, at the points `places`, (..., 2), m, to `out`, (...); NaN beyond the border."""
        flat, found = places.reshape(-1, 2), out.reshape(-1)
        for start in range(0, len(flat), _CHUNK):
            rows = slice(start, start + _CHUNK)
            steps = (flat[rows] + self.half) * self._scale
            self._look_up(np.ascontiguousarray(steps[:, 0]), np.ascontiguousarray(steps[:, 1]), True, found[rows])
        if not np.shares_memory(found, out):
            out[...] = found.reshape(out.shape)

    def around(self, places: Array, angles: Array, offsets: Array, out: Array) -> None:
        """Writes heights, m, at offsets (k, 2), m, rotated by angles (n,), rad, around points (n, 2), m, to `out`, (n, k).

        Heights beyond the border are NaN.
        """
        ahead, left = (np.ascontiguousarray(offsets[:, k]) for k in range(2))
        radius = np.sqrt((offsets * offsets).sum(axis=1).max(initial=0.0))
        nears_border = (np.abs(places) + radius * (1.0 + 1e-12) >= self.half).any(axis=1)
        along, across = self._scale
        turns = np.stack([np.cos(angles) * along, np.sin(angles) * along, np.sin(angles) * across, np.cos(angles) * across])
        first, second = ((places + self.half) * self._scale).T[..., None]
        size = max(1, _CHUNK // max(1, len(offsets)))
        for start in range(0, len(places), size):
            rows = slice(start, start + size)
            cos_u, sin_u, sin_v, cos_v = turns[:, rows]
            u, v = _outer(cos_u, ahead), _outer(sin_v, ahead)
            u -= _outer(sin_u, left)
            v += _outer(cos_v, left)
            u += first[rows]
            v += second[rows]
            self._look_up(u, v, bool(nears_border[rows].any()), out[rows])

    def _look_up(self, u: Array, v: Array, checks: bool, out: Array) -> None:
        """Writes heights, m, at points given in cells of the grid to `out`. The arrays u and v are overwritten.

        Args:
            u: Distances along x from the corner with the smallest x and y, in cells.
            v: Distances along y from that corner, in cells.
            checks: Whether points may lie beyond the border, where the result is NaN. If False, all points must lie within the border.
            out: Array of the shape of u.
        """
        columns, rows = self._cells
        column, row = np.floor(u), np.floor(v)
        if checks:
            outside = (u < 0.0) | (u > columns) | (v < 0.0) | (v > rows) | np.isnan(u) | np.isnan(v)
            column, row = (np.fmax(np.fmin(cell, last - 1), 0.0) for cell, last in ((column, columns), (row, rows)))
        u -= column
        v -= row
        row *= columns
        row += column
        cell = row.astype(np.intp)
        triangle = (u >= v) * np.intp(len(self._least))
        triangle += cell
        u *= self._along.take(triangle)
        v *= self._across.take(triangle)
        u += v
        np.add(self._least.take(cell), u, out=out)
        if checks:
            out[outside] = np.nan


def _outer(first: Array, second: Array) -> Array:
    """Outer product of two vectors, (n,) and (k,): (n, k). `np.einsum` is faster here than broadcasting."""
    products: Array = np.einsum("i,j->ij", first, second)
    return products


_UPRIGHT = 1e-9
"""Largest absolute x and y component of a height field's quaternion at which its z axis counts as vertical."""


class HeightField:
    """Heights of a height field at many points of all environments at once.

        ground = stepper.sensors.HeightField(model, "terrain")
        ground.heights(sim, places)  # (num_envs, n) m, of points (num_envs, n, 2) in the world
        ground.scan(sim, "base", offsets)  # (num_envs, n) m, around a body, rotated with its heading
        ground.heights(None, places)  # (..., n) m, without a simulation
        ground.around(places, headings, offsets)  # (n, k) m, without a simulation

    Each cell of the grid is two triangles, split by the diagonal from its corner with the smallest x and y, as in contacts. Elevations are
    read from the source of the model, because `Model` has no function for them. `from_elevation` uses an array instead.

    Args:
        model: The model.
        geom: Name or index of the height field's geom. Its z axis must be vertical.
        source: Source of the model, as for `stepper.load`; None uses the source from which the model was loaded.

    Raises:
        ValueError: The geom is no height field, or its z axis is not vertical; or the source is unknown or belongs to another model.
        KeyError, IndexError: There is no geom of that name or index.
    """

    _geom: int | None = None

    def __init__(self, model: Model, geom: str | int, *, source: Any = None):
        found = model.geom(geom)
        place = f"geom {found.name or found.id!r}"
        if found.type != "hfield":
            raise ValueError(f'{place} is a {found.type}, must be a height field (type="hfield")')
        reference = Stepper(model)
        quat = np.asarray(reference.geom_xquat)[found.id]
        if np.abs(quat[1:3]).max() > _UPRIGHT or _moves(model, found.bodyid):
            raise ValueError(
                f"{place} is inclined or on a joint; heights need a height field that is fixed in the world with a vertical z axis"
            )
        origin = origin_of(model) if source is None else Origin(source)
        if origin is None:
            raise ValueError(f"the elevations of {place} are unknown, because this process did not load the model from MJCF: pass source=")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # These warnings were issued when the model was loaded.
            m = copy.copy(compile_source(origin))
        field = int(m.geom_dataid[found.id]) if found.id < m.ngeom else -1
        if field < 0 or m.ngeom != model.ngeom or int(m.geom_type[found.id]) != 1:
            raise ValueError(
                f"the source belongs to another model: its geom {found.id} is no height field; pass the source of the loaded model"
            )
        rows, columns = int(m.hfield_nrow[field]), int(m.hfield_ncol[field])
        start = int(m.hfield_adr[field])
        top = (m.hfield_data[start : start + rows * columns].astype(np.float64) * m.hfield_size[field][2]).reshape(rows, columns)
        self._geom = found.id
        self._grid = HeightGrid(top, np.array(m.hfield_size[field][:2]))
        self._pos, self._angle = np.array(np.asarray(reference.geom_xpos)[found.id], np.float64), 2.0 * np.arctan2(quat[3], quat[0])

    @classmethod
    def from_elevation(cls, elevation: ArrayLike, half: ArrayLike, *, pos: ArrayLike = (0.0, 0.0, 0.0), angle: float = 0.0) -> HeightField:
        """Returns a height field from an array, without a model. Its position is the same in all environments.

        Args:
            elevation: Heights of the points above `pos`, (rows, columns) m: rows along y, columns along x, from the corner with the
                smallest x and y.
            half: Half the extent in x and y, (2,), m.
            pos: Position of the middle, m: (3,).
            angle: Angle about the z axis, rad.

        Raises:
            ValueError: An array has a wrong shape, or fewer than two rows or columns.
        """
        top, extent, middle = array_of("elevation", elevation).copy(), array_of("half", half).copy(), array_of("pos", pos).copy()
        if top.ndim != 2 or min(top.shape) < 2:
            raise ValueError(f"elevation has shape {top.shape}, must be (rows, columns) of at least 2 each")
        if extent.shape != (2,) or not (extent > 0).all() or middle.shape != (3,):
            raise ValueError(f"half is {half!r} and pos is {pos!r}, must be two positive lengths and three coordinates, m")
        made = cls.__new__(cls)
        made._grid, made._pos, made._angle = HeightGrid(top, extent), middle, float(angle)
        return made

    @property
    def elevation(self) -> Array:
        """Heights of the grid points above the geom, (rows, columns), m: rows along y, columns along x, from the smallest x and y."""
        top: Array = self._grid.top.copy()
        return top

    @property
    def half(self) -> Array:
        """Half the extent of the height field in x and y, (2,), m."""
        half: Array = self._grid.half.copy()
        return half

    def heights(self, sim: Stepper | None, places: ArrayLike, *, beyond: float = np.nan) -> Array:
        """Returns the heights of the ground at points, in world coordinates.

        Args:
            sim: The stepper. The position of the height field may differ between its environments (`sim.randomize(geom_pos=)`). None uses
                the position in the model.
            places: World x and y of the points, m: (num_envs, n, 2), or (n, 2) for all environments; without a stepper (..., 2).
            beyond: Value returned for points beyond the border of the field, m.

        Returns:
            Heights, float64, m: (num_envs, n); without a stepper (...), the shape of `places` without its last axis.

        Raises:
            ValueError: `places` has a wrong shape.
        """
        given = array_of("places", places)
        pos, angle = self._pose(sim)
        axes = angle.shape
        if sim is None and (given.ndim < 1 or given.shape[-1] != 2):
            raise ValueError(f"places has shape {given.shape}, must be (..., 2)")
        if sim is not None and (given.ndim < 2 or given.shape[-1] != 2 or given.shape[:-2] not in ((), axes)):
            raise ValueError(f"places has shape {given.shape}, must be {(*axes, 'n', 2)} or ('n', 2)")
        shift = pos if sim is None else pos[..., None, :]
        local = _rotated(given - shift[..., :2], -angle if sim is None else -angle[..., None])
        found = np.empty(local.shape[:-1])
        self._grid.at(local, found)
        found += shift[..., 2]
        return _filled(found, beyond)

    def scan(self, sim: Stepper, body: str | int, offsets: ArrayLike, *, beyond: float = np.nan) -> Array:
        """Returns heights of the ground at points around a body, as in observations for locomotion. Points rotate with the body's heading.

        Args:
            sim: The stepper.
            body: Name or index of the body.
            offsets: Positions of the points relative to the body's origin, ahead and to the left, (n, 2), m.
            beyond: Value returned for points beyond the border of the field, m.

        Returns:
            Heights in the world, (num_envs, n) float64, m. Subtract `sim.xpos` of the body for heights relative to it.

        Raises:
            ValueError: `offsets` has a wrong shape.
            KeyError, IndexError: There is no body of that name or index.
        """
        which = sim.model.body(body).id
        places = np.asarray(sim.xpos, dtype=np.float64)[..., which, :2]
        angles = headings(np.asarray(sim.xquat, dtype=np.float64)[..., which, :])
        return _filled(self._around(self._pose(sim), places, angles, offsets), beyond)

    def around(self, places: ArrayLike, angles: ArrayLike, offsets: ArrayLike, *, beyond: float = np.nan) -> Array:
        """Returns heights of the ground around given points, without a simulation. The height field has its pose in the model.

        Args:
            places: World x and y of the centres, (n, 2), m.
            angles: Headings about the z axis, (n,), rad.
            offsets: Positions relative to the centres, ahead and to the left, (k, 2), m.
            beyond: Value returned for points beyond the border of the field, m.

        Returns:
            Heights, (n, k) float64, m.

        Raises:
            ValueError: An array has a wrong shape.
        """
        middles, turns = array_of("places", places), array_of("angles", angles)
        if middles.shape != (*turns.shape, 2) or turns.ndim > 1:
            raise ValueError(f"places has shape {middles.shape} and angles {turns.shape}, must be (n, 2) and (n,)")
        return _filled(self._around(self._pose(None), middles, turns, offsets), beyond)

    def _pose(self, sim: Stepper | None) -> tuple[Array, Array]:
        """Position (..., 3), m, and angle about z (...), rad, of the height field, in each environment; without a stepper, in the model."""
        if sim is None or self._geom is None:
            return self._pos, np.asarray(self._angle)
        pos = np.asarray(sim.geom_xpos, dtype=np.float64)[..., self._geom, :]
        quat = np.asarray(sim.geom_xquat, dtype=np.float64)[..., self._geom, :]
        return pos, np.asarray(2.0 * np.arctan2(quat[..., 3], quat[..., 0]))

    def _around(self, pose: tuple[Array, Array], places: Array, angles: Array, offsets: ArrayLike) -> Array:
        """Heights of the ground as in `around`, (n, k), m, for the given pose of the height field; NaN beyond the border."""
        given = array_of("offsets", offsets)
        if given.ndim != 2 or given.shape[1] != 2:
            raise ValueError(f"offsets has shape {given.shape}, must be (n, 2)")
        pos, angle = pose
        found = np.empty((*angles.shape, len(given)))
        local, height = np.atleast_2d(_rotated(places - pos[..., :2], -angle)), pos[..., 2, None]
        self._grid.around(local, np.atleast_1d(angles - angle), given, found.reshape(len(local), len(given)))
        found += height
        return found


def _moves(model: Model, body: int) -> bool:
    """Whether a body or one of its ancestors has a joint."""
    while body:
        found = model.body(body)
        if found.dofnum:
            return True
        body = found.parentid
    return False


def _filled(heights: Array, beyond: float) -> Array:
    """Replaces NaN in heights by `beyond`, in place, and returns them."""
    if not np.isnan(beyond):
        heights[np.isnan(heights)] = beyond
    return heights


def _rotated(places: Array, angle: Array) -> Array:
    """Points (..., 2) in the plane, rotated about the origin by angles (...), rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * places[..., 0] - s * places[..., 1], s * places[..., 0] + c * places[..., 1]], axis=-1)
