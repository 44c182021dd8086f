"""Quantities of a stepper that are computed in Python: `Stepper.read`, `Stepper.inverse_dynamics` and `Stepper.rays`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper._hints import did_you_mean_or_all, replacement
from stepper._stepper import Model, Stepper

Array = NDArray[Any]
Key = str | int

_BODIES = ("xpos", "xquat", "body_linvel", "body_angvel", "subtree_com", "xipos", "cinert", "cvel", "cfrc_ext", "body_contact_force")
_DOFS = ("qvel", "qacc", "qacc_smooth", "qfrc_bias", "qfrc_actuator", "qfrc_constraint", "qfrc_applied")
KINDS: dict[str, str] = {
    **dict.fromkeys((*_BODIES, "xfrc_applied"), "body"),
    **dict.fromkeys(("site_xpos", "site_xquat"), "site"),
    **dict.fromkeys(("geom_xpos", "geom_xquat"), "geom"),
    **dict.fromkeys(("actuator_force", "ctrl", "actuator_saturation"), "actuator"),
    **dict.fromkeys(("closed_eq_data", "eq_active"), "equality"),
    **dict.fromkeys(("sensordata", "sensordata_ideal"), "sensor"),
    **dict.fromkeys(("qpos", *_DOFS), "joint"),
}
"""Kind of the elements of each quantity, by name of the quantity.

A body, site, geom, actuator or equality has one entry in the array of the quantity. A joint or sensor can have several.
"""


def read(now: Any, name: str, of: Key | Sequence[Key] | None = None) -> Array:
    """Values of a quantity for all or some elements, (num_envs, n, ...), in its unit; see `Stepper.read`.

    Args:
        now: A `Stepper`, a `stepper.envs.TaskView` or a `World` of a study, which have the same attributes.
        name: Name of the quantity, such as "xpos".
        of: Name or index of an element, or several; None selects all elements.

    Raises:
        ValueError: An unknown quantity.
    """
    if name not in KINDS:
        if name in now.model.sensor_names:
            raise ValueError(f"there is no quantity {name!r}, but a sensor: read('sensordata', {name!r})")
        hint = f"; use sim.{name}" if hasattr(Stepper, name) else replacement("Stepper", name)
        raise ValueError(f"there is no quantity {name!r}{hint or did_you_mean_or_all(name, sorted(KINDS))}")
    values = np.asarray(getattr(now, name))
    if of is not None:
        axis = 0 if now.num_envs is None else 1
        values = np.take(values, _places(now.model, KINDS[name], name, of), axis=axis)
    found: Array = np.array(values)
    return found


def inverse_dynamics(sim: Stepper, qacc: ArrayLike) -> Array:
    """Joint forces, (num_envs, nv), N and N m, for accelerations, (num_envs, nv), m/s^2 and rad/s^2; see `Stepper.inverse_dynamics`."""
    shape = () if sim.num_envs is None else (sim.num_envs,)
    wanted = array_of("qacc", qacc)
    if wanted.shape not in ((sim.model.nv,), (*shape, sim.model.nv)):
        raise ValueError(f"qacc has shape {wanted.shape}, must be {_shapes(shape, sim.model.nv)}")
    if not np.isfinite(wanted).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(wanted))[0])
        raise ValueError(f"qacc{list(place)} is {wanted[place]}, must be a finite number")
    # qacc_smooth contains bias, passive, actuator and applied forces. Inverse dynamics must not subtract the last two, so they are added
    # below.
    free = sim.qacc_smooth
    excess = np.broadcast_to(wanted, (*shape, sim.model.nv)) - free
    forces = np.einsum("...ij,...j->...i", sim.mass_matrix(), excess)
    forces += np.asarray(sim.qfrc_actuator)
    forces += np.asarray(sim.qfrc_applied)
    forces += _of_applied(sim)
    found: Array = forces.astype(free.dtype, copy=False)
    return found


def around_body(sim: Stepper, points: ArrayLike, directions: ArrayLike, body: Key, axes: str) -> tuple[Array, Array]:
    """World points (m) and directions, (num_envs, n, 3) each, of rays that are given in the frame of a body; see `Stepper.rays`.

    Args:
        sim: The stepper.
        points: Start points relative to the body, (n, 3) or (num_envs, n, 3), m.
        directions: Direction vectors, (n, 3) or (num_envs, n, 3).
        body: Name or index of the body.
        axes: Axes of `points` and `directions`: "body", "world", or "heading" (world axes, turned about the vertical by the body's
            heading).
    """
    if axes not in ("body", "heading", "world"):
        raise ValueError(f"axes is {axes!r}, must be 'body', 'heading' or 'world'")
    which = sim.model.body(body).id
    places, ways = _of_rays(sim, points, "points"), _of_rays(sim, directions, "directions")
    if axes != "world":
        quat = np.asarray(sim.xquat, dtype=np.float64)[..., which, :]
        turn = _about_vertical(headings(quat)) if axes == "heading" else quat
        places, ways = _rotated(turn, places), _rotated(turn, ways)
    return places + np.asarray(sim.xpos, dtype=np.float64)[..., which, None, :], ways


def _of_applied(sim: Stepper) -> Array:
    """Joint forces equivalent to `xfrc_applied`, (num_envs, nv), N or N m."""
    applied = np.asarray(sim.xfrc_applied, dtype=np.float64)
    total = np.zeros(np.shape(sim.qvel))
    for body in np.flatnonzero(np.any(applied != 0, axis=tuple(a for a in range(applied.ndim) if a != applied.ndim - 2))):
        force, torque = applied[..., body, :3], applied[..., body, 3:]
        arm = np.asarray(sim.xipos)[..., body, :] - np.asarray(sim.xpos)[..., body, :]
        wrench = np.concatenate([force, torque + np.cross(arm, force)], axis=-1)
        total += np.einsum("...ij,...i->...j", np.asarray(sim.jacobian(body=int(body))), wrench)
    return total


def _shapes(envs: tuple[int, ...], *row: int | str) -> str:
    """Accepted shapes of an argument, for a message: one row for each of the environments `envs`, or one row for all."""
    one = f"({', '.join(map(str, row))}{',' if len(row) == 1 else ''})"
    return f"({', '.join(map(str, (*envs, *row)))}) or {one}" if envs else one


def _of_rays(sim: Stepper, given: ArrayLike, name: str) -> Array:
    """Array of points or directions of rays, (n, 3) or (num_envs, n, 3), after a check of its shape."""
    rows = array_of(name, given)
    shape = () if sim.num_envs is None else (sim.num_envs,)
    if rows.ndim < 2 or rows.shape[-1] != 3 or rows.shape[:-2] not in ((), shape):
        raise ValueError(f"{name} has shape {rows.shape}, must be {_shapes(shape, 'n', 3)}")
    return rows


def _about_vertical(angle: Array) -> Array:
    """Unit quaternions (..., 4) of turns about the world's z axis by angles (...), rad."""
    half = 0.5 * angle
    return np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)


def _rotated(quat: Array, vectors: Array) -> Array:
    """Vectors (..., n, 3) turned by unit quaternions (..., 4)."""
    w, u = quat[..., None, :1], quat[..., None, 1:]
    across = 2.0 * np.cross(u, vectors)
    turned: Array = vectors + w * across + np.cross(u, across)
    return turned


def _places(model: Model, kind: str, name: str, of: Key | Sequence[Key]) -> Any:
    """Indices of elements along the axis of a quantity. For one body, site, geom or equality it is an int, which removes the axis."""
    several = not isinstance(of, str | int | np.integer)
    keys: Sequence[Any] = of if several else [of]  # type: ignore[assignment]
    if kind in ("body", "site", "geom", "equality"):
        found = [int(getattr(model, kind)(key).id) for key in keys]
        return found if several else found[0]
    columns: list[int] = []
    for key in keys:
        if kind == "joint":
            joint = model.joint(key)
            first, count = (joint.qposadr, joint.nq) if name == "qpos" else (joint.dofadr, joint.nv)
        elif kind == "sensor":
            sensor = model.sensor(key)
            first, count = sensor.adr, sensor.dim
        else:
            first, count = model.actuator(key).id, 1
        columns += range(first, first + count)
    return columns


def output_array(shape: tuple[int, ...], dtype: Any, out: Array | None) -> Array:
    """Array in which the caller stores a result, (...) in any unit: `out` if it is given, otherwise a new uninitialised array."""
    if out is None:
        return np.empty(shape, dtype)
    if out.shape != shape or out.dtype != dtype:
        raise ValueError(f"out has shape {out.shape} and type {out.dtype}, must have {shape} and {dtype}")
    return out


def headings(quat: Array) -> Array:
    """Headings (...) of frames with unit quaternions (w, x, y, z), (..., 4): angle of the x axis about the world's z axis, rad."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    angles: Array = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return angles
