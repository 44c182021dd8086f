"""Quantities of bodies as MuJoCo lays them out: inertias, velocities and contact forces about the centre of mass of the body's tree.

    import stepper

    sim = stepper.Stepper(stepper.load("humanoid.xml"), 1024)
    sim.step()
    stepper.bodies.cinert(sim)  # (1024, nbody, 10)

Names, axes, order and points of reference are those of mjData (https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjdata).
All are of the present state, as `mj_forward` leaves them, with `num_envs` in front and of the scalar type of the stepper. The point of
reference is the centre of mass of the tree that a body belongs to: of a child of the world, with all that hangs from it. The same are
read-only attributes of the stepper, `sim.cinert`; here they are arrays of the caller's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model, Stepper
from stepper.quantities import written

Array = NDArray[Any]


def xipos(sim: Stepper, *, out: Array | None = None) -> Array:
    """Centres of mass of the bodies in the world, m.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 3), MuJoCo's xipos.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    return written(sim.xipos, out)


def cinert(sim: Stepper, *, out: Array | None = None) -> Array:
    """Inertias of the bodies about the centre of mass of their tree, world axes.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 10), MuJoCo's cinert: the inertia's xx, yy, zz, xy, xz, yz in kg m^2, the mass times the place of the body's
        centre of mass in kg m, the mass in kg. The world's row is zero.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    return written(sim.cinert, out)


def cvel(sim: Stepper, *, out: Array | None = None) -> Array:
    """Velocities of the bodies, of the point of each that is at the centre of mass of its tree, world axes.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 6), MuJoCo's cvel: angular velocity (3) in rad/s, linear velocity (3) in m/s.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    return written(sim.cvel, out)


def cfrc_ext(sim: Stepper, *, xfrc_applied: Array | None = None, out: Array | None = None) -> Array:
    """Torques and forces on the bodies of the last step's contacts, about the centre of mass of their tree, world axes.

    MuJoCo counts forces of connect and weld equalities among them, which are not in it. Where no step was made since the state was set
    there are no contacts, and it is zero.

    Args:
        sim: The stepper.
        xfrc_applied: Forces that are counted as well, (num_envs, nbody, 6) in N and N m at the bodies' centres of mass:
            `sim.xfrc_applied`, as MuJoCo counts them. None is none.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 6), MuJoCo's cfrc_ext: torque (3) in N m, force (3) in N. The world's row is zero.

    Raises:
        ValueError: An `out` of another shape or scalar type, forces of another shape.
    """
    contacts = sim.cfrc_ext
    if xfrc_applied is None:
        return written(contacts, out)
    applied = np.asarray(xfrc_applied)
    if applied.shape != contacts.shape:
        raise ValueError(f"xfrc_applied has shape {applied.shape}, must be {contacts.shape}")
    arm = sim.xipos - np.take(sim.subtree_com, _roots(sim.model), axis=-2)
    force = np.array(applied[..., :3])  # A copy, as `out` may be the same array.
    torque = applied[..., 3:] + np.cross(arm, force)
    out = written(contacts, out)
    out[..., :3] += torque
    out[..., 3:] += force
    out[..., 0, :] = 0.0
    return out


QUANTITIES: Mapping[str, Callable[[Stepper], Array]] = {"xipos": xipos, "cinert": cinert, "cvel": cvel, "cfrc_ext": cfrc_ext}
"""The functions of this module by name."""


@lru_cache(maxsize=8)
def _roots(model: Model) -> Array:
    """The first body of the tree that each body belongs to, (nbody,)."""
    roots = np.zeros(model.nbody, dtype=np.int64)
    for body in range(1, model.nbody):
        parent = model.body(body).parentid
        roots[body] = roots[parent] if parent else body
    return roots
