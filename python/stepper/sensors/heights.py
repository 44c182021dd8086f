"""Heights of a height field under places: what a robot that sees the ground is told of it."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._quantities import given_out, headings
from stepper._stepper import Model, Stepper
from stepper.loading.load import compile_source
from stepper.loading.origins import Origin, origin_of

Array = NDArray[Any]

_UPRIGHT = 1e-9
"""Largest x and y of a quaternion of a field whose z axis is taken for vertical."""


class HeightField:
    """Heights of a geom that is a height field, anywhere, in all environments at once.

        ground = stepper.sensors.HeightField(model, "terrain")
        ground.heights(sim, places)  # (num_envs, n) m, of places (num_envs, n, 2) in the world
        ground.scan(sim, "base", offsets)  # (num_envs, n) m, around a body, turned with it

    Between its points the ground is two triangles in every cell, parted by the diagonal from the least corner: those that contacts see.
    A model has no elevations to be read, so these are read again from what the model was loaded from.

    Args:
        model: The scene.
        geom: Name or index of the geom. The field's z axis must be vertical.
        source: What `stepper.load` takes; None is what the model was loaded from.

    Raises:
        ValueError: A geom of another kind, a field that is inclined, a source that is not known or of another model.
        KeyError, IndexError: No geom of that name or index.
    """

    def __init__(self, model: Model, geom: str | int, *, source: Any = None):
        found = model.geom(geom)
        place = f"geom {found.name or found.id!r}"
        if found.type != "hfield":
            raise ValueError(f'{place} is a {found.type}, must be a height field (type="hfield")')
        if np.abs(np.asarray(found.quat)[1:3]).max() > _UPRIGHT or model.body(found.bodyid).dofnum:
            raise ValueError(f"{place} is inclined or on a joint: heights under places are those of a field whose z axis is vertical")
        origin = origin_of(model) if source is None else Origin(source)
        if origin is None:
            raise ValueError(f"the elevations of {place} are not known, as this process did not load the model from MJCF: give source=")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Whoever loaded the model has seen them.
            m = copy.copy(compile_source(origin.source, origin.package_dirs))
        field = int(m.geom_dataid[found.id]) if found.id < m.ngeom else -1
        if field < 0 or m.ngeom != model.ngeom or int(m.geom_type[found.id]) != 1:
            raise ValueError(f"the source is of another model: its geom {found.id} is no height field")
        rows, columns = int(m.hfield_nrow[field]), int(m.hfield_ncol[field])
        start = int(m.hfield_adr[field])
        self._geom = found.id
        self._half = np.array(m.hfield_size[field][:2])
        self._top = (m.hfield_data[start : start + rows * columns].astype(np.float64) * m.hfield_size[field][2]).reshape(rows, columns)

    @property
    def elevation(self) -> Array:
        """Heights of its points above the geom, (rows, columns) m: rows along y, columns along x, from the least corner."""
        top: Array = self._top.copy()
        return top

    @property
    def half(self) -> Array:
        """Half its extent in x and y, m: (2,)."""
        half: Array = self._half.copy()
        return half

    def heights(self, sim: Stepper, places: ArrayLike, *, beyond: float = np.nan, out: Array | None = None) -> Array:
        """Heights of the ground in the world.

        Args:
            sim: The stepper, whose environments may have places of their own for the geom (`sim.randomize(geom_pos=)`).
            places: World x and y, (num_envs, n, 2) or (n, 2) for all, m.
            beyond: What is said of places beyond the field's border, m.
            out: Array to write to; None is a new one.

        Returns:
            (num_envs, n) float64, m.

        Raises:
            ValueError: Places or an `out` of another shape or scalar type.
        """
        given = np.asarray(places, dtype=np.float64)
        axes = () if sim.num_envs is None else (sim.num_envs,)
        if given.ndim < 2 or given.shape[-1] != 2 or given.shape[:-2] not in ((), axes):
            raise ValueError(f"places has shape {given.shape}, must be {(*axes, 'n', 2)} or ('n', 2)")
        pos = np.asarray(sim.geom_xpos, dtype=np.float64)[..., self._geom, :]
        quat = np.asarray(sim.geom_xquat, dtype=np.float64)[..., self._geom, :]
        local = _turned(given - pos[..., None, :2], -2.0 * np.arctan2(quat[..., 3], quat[..., 0]))
        found = self._of_grid(local) + pos[..., None, 2]
        outside = (np.abs(local) > self._half).any(axis=-1)
        found = np.where(outside, beyond, found)
        return given_out(found, out)

    def scan(self, sim: Stepper, body: str | int, offsets: ArrayLike, *, beyond: float = np.nan, out: Array | None = None) -> Array:
        """Heights of the ground around a body, of places that turn with its heading, as locomotion policies observe them.

        Args:
            sim: The stepper.
            body: Name or index of the body.
            offsets: Places ahead of the body's origin and to its left, (n, 2) m.
            beyond: What is said of places beyond the field's border, m.
            out: Array to write to; None is a new one.

        Returns:
            (num_envs, n) float64, m: heights in the world. Less `sim.xpos` of the body they are those beside it.

        Raises:
            ValueError: Offsets or an `out` of another shape or scalar type.
            KeyError, IndexError: No body of that name or index.
        """
        which = sim.model.body(body).id
        given = np.asarray(offsets, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != 2:
            raise ValueError(f"offsets has shape {given.shape}, must be (n, 2)")
        heading = headings(np.asarray(sim.xquat, dtype=np.float64)[..., which, :])
        around = _turned(np.broadcast_to(given, (*heading.shape, *given.shape)), heading)
        return self.heights(sim, around + np.asarray(sim.xpos, dtype=np.float64)[..., which, None, :2], beyond=beyond, out=out)

    def _of_grid(self, local: Array) -> Array:
        """Heights above the geom at places (..., 2) of its frame; beyond its border those of the border's cells go on."""
        rows, columns = self._top.shape
        cells = np.array([columns - 1, rows - 1])
        steps = (local + self._half) * (cells / (2.0 * self._half))
        least = np.clip(np.floor(steps), 0, cells - 1).astype(np.int64)
        along, across = np.moveaxis(steps - least, -1, 0)
        c, r = least[..., 0], least[..., 1]
        low, high = self._top[r, c], self._top[r + 1, c + 1]
        corner = np.where(along >= across, self._top[r, c + 1], self._top[r + 1, c])
        first, second = np.maximum(along, across), np.minimum(along, across)
        heights: Array = low + first * (corner - low) + second * (high - corner)
        return heights


def _turned(places: Array, angle: Array) -> Array:
    """Places (..., n, 2) turned by angles (...)."""
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.stack([c * places[..., 0] - s * places[..., 1], s * places[..., 0] + c * places[..., 1]], axis=-1)
