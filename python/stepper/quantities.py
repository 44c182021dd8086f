"""Quantities of all environments by name, into arrays of one's own: poses, velocities, forces, mass matrices, inverse dynamics.

    import stepper

    sim = stepper.Stepper(stepper.load("humanoid.xml"), 256)
    stepper.quantities.read(sim, "xpos", "torso")  # (256, 3)
    stepper.quantities.read(sim, "qvel", ["left_knee", "right_knee"])  # (256, 2)
    stepper.quantities.mass_matrix(sim, out=mine)  # (256, nv, nv)
    stepper.quantities.rays(sim, points, directions, body="torso")  # distances and geoms, (256, n) each

The first axis is that of the environments; a stepper without one has none. All is computed for all environments in one pass; what the
attributes of `Stepper` say, which `read` gives, is kept until something changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._hints import near_or_all
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
    **dict.fromkeys(("sensordata", "sensordata_ideal"), "sensor"),
    **dict.fromkeys(("qpos", *_DOFS), "joint"),
}
"""What the numbers of a quantity belong to: a row each of a body, site, geom or actuator; columns of a joint or sensor."""


def read(sim: Stepper, name: str, of: Key | Sequence[Key] | None = None, *, out: Array | None = None) -> Array:
    """A quantity, of all its elements or of some by name or index.

    Args:
        sim: The stepper.
        name: An attribute of `Stepper` in `KINDS`: "xpos", "qvel", "sensordata".
        of: A body, site, geom, joint, actuator or sensor, whichever the quantity is of, or several; None is all. One body, site or geom
            is without its axis: (num_envs, 3). Columns of joints and sensors stand one after the other: (num_envs, n).
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, ...) of the scalar type of the stepper, the caller's own.

    Raises:
        ValueError: An unknown quantity; an `out` of another shape or scalar type.
        KeyError, IndexError: No element of that name or index.
    """
    if name not in KINDS:
        raise ValueError(f"there is no quantity {name!r}{near_or_all(name, sorted(KINDS))}")
    values = np.asarray(getattr(sim, name))
    if of is not None:
        axis = 0 if sim.num_envs is None else 1
        chosen = _places(sim.model, KINDS[name], name, of)
        values = np.take(values, chosen, axis=axis)
    return written(values, out)


def jacobian(sim: Stepper, *, body: Key | None = None, site: Key | None = None, out: Array | None = None) -> Array:
    """Jacobian of the origin of a body's frame, or of a site: see `Stepper.jacobian`.

    Returns:
        (num_envs, 6, nv), world axes: three rows of the linear velocity, then three of the angular one.

    Raises:
        ValueError: Both were given, or neither; an `out` of another shape or scalar type.
        KeyError, IndexError: No element of that name or index.
    """
    return written(np.asarray(sim.jacobian(body=body, site=site)), out)


def mass_matrix(sim: Stepper, *, out: Array | None = None) -> Array:
    """Mass matrices of the present configurations, armature included: see `Stepper.mass_matrix`.

    Returns:
        (num_envs, nv, nv) of the scalar type of the stepper.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    return given_out(sim.mass_matrix(), out)


def inverse_dynamics(sim: Stepper, qacc: ArrayLike, *, out: Array | None = None) -> Array:
    """Forces on the joints that would accelerate the present states so: M qacc + bias - passive.

    Passive forces are those of springs, dampers, gravity compensation and the medium. What actuators do and what is applied is not
    subtracted, as they are what makes these forces; nor are contacts and other constraints, whose forces of the last step are
    `sim.qfrc_constraint`. It is `mj_inverse` with constraints disabled.

    Args:
        sim: The stepper.
        qacc: Accelerations, (num_envs, nv) or (nv,), m/s^2 or rad/s^2.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nv) of the scalar type of the stepper, N or N m.

    Raises:
        ValueError: Accelerations or an `out` of another shape or scalar type.
    """
    shape = () if sim.num_envs is None else (sim.num_envs,)
    wanted = np.asarray(qacc, dtype=np.float64)
    if wanted.shape not in ((sim.model.nv,), (*shape, sim.model.nv)):
        raise ValueError(f"qacc has shape {wanted.shape}, must be {(*shape, sim.model.nv)} or ({sim.model.nv},)")
    # What the accelerations without constraints say of bias and passive forces, less the forces that made them.
    free = sim.qacc_smooth
    excess = np.broadcast_to(wanted, (*shape, sim.model.nv)) - free
    forces = np.einsum("...ij,...j->...i", mass_matrix(sim), excess)
    forces += np.asarray(sim.qfrc_actuator)
    forces += np.asarray(sim.qfrc_applied)
    forces += _of_applied(sim)
    return given_out(forces.astype(free.dtype, copy=False), out)


def rays(
    sim: Stepper,
    points: ArrayLike,
    directions: ArrayLike,
    *,
    body: Key | None = None,
    axes: Literal["body", "heading", "world"] = "body",
    geoms: Sequence[Key] | None = None,
    exclude: Key | None = None,
    out: Array | None = None,
    out_geoms: Array | None = None,
) -> tuple[Array, Array]:
    """What rays meet in the world, or around a body as its lidar and its depth sensors see it: see `Stepper.rays`.

        grid = np.stack(np.meshgrid(np.linspace(-1, 1, 17), np.linspace(-0.5, 0.5, 11), [1.0]), axis=-1).reshape(-1, 3)
        distances, _ = rays(sim, grid, np.tile([0.0, 0.0, -1.0], (len(grid), 1)), body="base", axes="heading")

    Args:
        sim: The stepper.
        points: Where the rays begin, (num_envs, n, 3) or (n, 3) for all environments, m: in the world, or from the origin of the body.
        directions: Where they go, of any length above 0, (num_envs, n, 3) or (n, 3).
        body: Name or index of the body that the rays belong to; its own geoms are not met. None is the world.
        axes: In whose axes points and directions around a body are: its own; the world's, turned by its heading alone; the world's.
        geoms: Names or indices of the geoms that the rays can meet; None is all of them.
        exclude: Name or index of the body whose geoms are not met; None is `body`.
        out: Array to write distances to; None is a new one.
        out_geoms: Array to write the indices of geoms to, int32; None is a new one.

    Returns:
        Distances in m, (num_envs, n) of the scalar type of the stepper, and the indices of the geoms that are met, (num_envs, n) int32.
        Both are -1 where nothing is.

    Raises:
        ValueError: Arrays of another shape or scalar type, a point that is not finite, a direction of length 0, unknown axes, a mesh that
            is no part of the model.
        KeyError, IndexError: No body or geom of that name or index.
    """
    if axes not in ("body", "heading", "world"):
        raise ValueError(f"axes is {axes!r}, must be 'body', 'heading' or 'world'")
    if body is not None:
        which = sim.model.body(body).id
        exclude = which if exclude is None else exclude
        places, ways = _of_rays(sim, points, "points"), _of_rays(sim, directions, "directions")
        if axes != "world":
            quat = np.asarray(sim.xquat, dtype=np.float64)[..., which, :]
            turn = _about_vertical(headings(quat)) if axes == "heading" else quat
            places, ways = _rotated(turn, places), _rotated(turn, ways)
        points, directions = places + np.asarray(sim.xpos, dtype=np.float64)[..., which, None, :], ways
    distances, met = sim.rays(points, directions, geoms=geoms, exclude=exclude)
    return given_out(distances, out), given_out(met, out_geoms)


def _of_applied(sim: Stepper) -> Array:
    """Forces on the joints of `xfrc_applied`, (num_envs, nv)."""
    applied = np.asarray(sim.xfrc_applied, dtype=np.float64)
    total = np.zeros(np.shape(sim.qvel))
    for body in np.flatnonzero(np.any(applied != 0, axis=tuple(a for a in range(applied.ndim) if a != applied.ndim - 2))):
        force, torque = applied[..., body, :3], applied[..., body, 3:]
        arm = np.asarray(sim.xipos)[..., body, :] - np.asarray(sim.xpos)[..., body, :]
        wrench = np.concatenate([force, torque + np.cross(arm, force)], axis=-1)
        total += np.einsum("...ij,...i->...j", np.asarray(sim.jacobian(body=int(body))), wrench)
    return total


def _of_rays(sim: Stepper, given: ArrayLike, name: str) -> Array:
    """Three numbers of each ray, of all environments or of each."""
    rows = np.asarray(given, dtype=np.float64)
    shape = () if sim.num_envs is None else (sim.num_envs,)
    if rows.ndim < 2 or rows.shape[-1] != 3 or rows.shape[:-2] not in ((), shape):
        raise ValueError(f"{name} has shape {rows.shape}, must be {(*shape, 'n', 3)} or ('n', 3)")
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
    """Indices along the axis of the elements."""
    several = not isinstance(of, str | int | np.integer)
    keys: Sequence[Any] = of if several else [of]  # type: ignore[assignment]
    if kind in ("body", "site", "geom"):
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


def room(shape: tuple[int, ...], dtype: Any, out: Array | None) -> Array:
    """An array of a shape and scalar type: `out` if it is given, or a new one.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    if out is None:
        return np.empty(shape, dtype)
    if out.shape != shape or out.dtype != dtype:
        raise ValueError(f"out has shape {out.shape} and type {out.dtype}, must have {shape} and {dtype}")
    return out


def written(values: Array, out: Array | None) -> Array:
    """A copy of an array, in `out` if it is given.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    found = room(values.shape, values.dtype, out)
    found[...] = values
    return found


def given_out(values: Array, out: Array | None) -> Array:
    """An array that is the caller's already; a copy of it in `out` if that is given.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    return values if out is None else written(values, out)


def headings(quat: Array) -> Array:
    """Angles (...) about the world's z axis to where the x axis of unit quaternions (w, x, y, z), (..., 4), points, rad."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    angles: Array = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return angles
