"""Floor and free base that `stepper.load` adds to a source (arguments `floor` and `free_base`)."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from stepper._stepper import ModelError
from stepper.loading.origins import Origin

FLOOR, FREE_BASE = "floor", "free_base"
"""Names of the added plane and of the added free joint."""
_COLOUR = (0.5, 0.55, 0.6, 1.0)
"""Colour of the added plane in pictures: red, green, blue, opacity."""
_UPWARD = 0.5
"""Smallest z component of the normal of a plane that counts as a floor. A steeper plane is a wall."""


def complete(spec: Any, origin: Origin) -> Any:
    """Adds the floor and the free base of an origin to a `mujoco.MjSpec`, and compiles it to a `mujoco.MjModel`.

    Raises:
        ModelError: The model has a floor or a free base already, or no root link.
        ValueError: MuJoCo's compiler cannot read the model.
    """
    base = _freed(spec) if origin.free_base else None
    if origin.floor is None:
        return spec.compile()
    mujoco = import_module("mujoco")
    if any(geom.name == FLOOR for geom in spec.geoms):
        raise ModelError(f'floor is {origin.floor:g}, and the model has a geom "{FLOOR}" already: omit the argument floor')
    spec.worldbody.add_geom(name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, origin.floor], rgba=_COLOUR)
    m = spec.compile()
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    floor = m.geom(FLOOR).id
    _check_no_floor(mujoco, m, data, floor)
    if base is None:
        return m
    collides = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
    above = [mujoco.mj_geomDistance(m, data, floor, k, np.inf, None) for k in np.flatnonzero(collides & (m.geom_bodyid != 0)) if k != floor]
    base.pos = [*base.pos[:2], base.pos[2] - min(above, default=0.0)]
    return spec.compile()


def _check_no_floor(mujoco: Any, m: Any, data: Any, added: int) -> None:
    """Raises a ModelError if a fixed plane other than the added one faces upward."""
    for k in np.flatnonzero(m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        if k != added and data.geom_xmat[k].reshape(3, 3)[2, 2] > _UPWARD:
            label = m.geom(k).name or f"#{k}"
            raise ModelError(
                f"floor is {m.geom_pos[added][2]:g}, and the plane {label} of the model faces upward already: omit the argument floor"
            )


def _freed(spec: Any) -> Any:
    """Root link of a URDF, to which the function adds a free joint."""
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1:
        names = ", ".join(root.name for root in roots) or "none"
        raise ModelError(f"free_base is True, which needs one root link, and the links on the world are: {names}; omit free_base")
    (root,) = roots
    if list(root.joints):
        joint = root.joints[0].name
        raise ModelError(f'free_base is True, and the root link "{root.name}" moves on the joint "{joint}" already: omit free_base')
    root.add_freejoint(name=FREE_BASE)
    return root
