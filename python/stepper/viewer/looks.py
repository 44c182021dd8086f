"""Visual elements of a scene, from MuJoCo's model: colours, lights, cameras and visual meshes, which stepper's model lacks."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model, Stepper
from stepper.loading import Origin, compile_source, origin_of
from stepper.shared.machine import require

Array = NDArray[Any]

_KINDS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "mesh")
"""Values of `Geom.type` for MuJoCo's kinds of geoms (mjtGeom), whose last is a signed distance field."""
_SIZED = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_JOINTS = ("free", "ball", "slide", "hinge")
_POSES = ("geom_pos", "geom_quat", "body_pos", "body_quat")


class LooksError(ValueError):
    """Scene that cannot be drawn; the message has the missing part and the remedy."""


def looks_of(model: Model, source: Any = None) -> Any | None:
    """`mujoco.MjModel` of a scene for drawing, with the positions and sizes of stepper's model.

    Args:
        model: The scene.
        source: Source of the model, as for `stepper.load`, or an `Origin`; None is the one from which the model was loaded.

    Returns:
        The model; None if its source is unknown.

    Raises:
        LooksError: The source has other bodies, joints or geoms than the model.
    """
    origin = source if isinstance(source, Origin) else Origin(source) if source is not None else origin_of(model)
    if origin is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # They were given when the model was loaded.
        m = copy.deepcopy(compile_source(origin.source, origin.package_dirs))
    _check_same(model, m)
    for name in _POSES:
        getattr(m, name)[:] = getattr(model, name)
    sized = sized_geoms(model)
    m.geom_size[sized] = model.geom_size[sized]
    return m


def sized_geoms(model: Model) -> list[int]:
    """Geoms whose extent follows from their size alone."""
    return [g for g in range(model.ngeom) if model.geom(g).type in _SIZED]


def _check_same(model: Model, m: Any) -> None:
    """Raises LooksError unless MuJoCo's model has the same bodies, joints and geoms."""
    mujoco = require("mujoco", "to read the looks of a model")

    def names(kind: Any, count: int) -> list[str]:
        return [mujoco.mj_id2name(m, kind, i) or "" for i in range(count)]

    def geoms(kinds: list[str], bodies: list[int], called: list[str]) -> list[str]:
        return [f"{kind} {name!r} of body {body}" for kind, body, name in zip(kinds, bodies, called, strict=True)]

    ours = [model.geom(g) for g in range(model.ngeom)]
    joints = [model.joint(j) for j in range(model.njnt)]
    compared = {
        "bodies": (list(model.body_names), names(mujoco.mjtObj.mjOBJ_BODY, m.nbody)),
        "joints": (
            [f"{joint.type} {joint.name!r}" for joint in joints],
            [f"{_JOINTS[k]} {name!r}" for k, name in zip(m.jnt_type, names(mujoco.mjtObj.mjOBJ_JOINT, m.njnt), strict=True)],
        ),
        "geoms": (
            geoms([g.type for g in ours], [g.bodyid for g in ours], [g.name for g in ours]),
            geoms([_KINDS[k] for k in m.geom_type], m.geom_bodyid.tolist(), names(mujoco.mjtObj.mjOBJ_GEOM, m.ngeom)),
        ),
    }
    for what, (mine, theirs) in compared.items():
        if mine != theirs:
            k = next((k for k, (a, b) in enumerate(zip(mine, theirs, strict=False)) if a != b), min(len(mine), len(theirs)))
            here, there = (", ".join(group[k : k + 1]) or "nothing" for group in (mine, theirs))
            raise LooksError(f"the source is of another model: {len(theirs)} {what} and {len(mine)}, number {k} is {there} and not {here}")


def row(sim: Stepper, name: str, env: int) -> Array:
    """Value of a quantity in one environment, (...), in its unit, with or without an axis of environments."""
    values = np.asarray(getattr(sim, name))
    return values if sim.num_envs is None else values[env]
