"""Visual elements of a model: colours, lights, cameras and visual meshes. These are only in MuJoCo's model, compiled from the source."""

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
"""Value of `Geom.type` for each value of MuJoCo's mjtGeom. The last is a signed distance field, which is loaded as a mesh."""
_SIZED = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_JOINTS = ("free", "ball", "slide", "hinge")
_POSES = ("geom_pos", "geom_quat", "body_pos", "body_quat")


class LooksError(ValueError):
    """A model cannot be drawn, because its source is missing or belongs to another model. The message has a remedy."""


def looks_of(model: Model, source: Any = None) -> Any | None:
    """`mujoco.MjModel` for drawing, compiled from the model's source, with the positions and sizes of stepper's model.

    Args:
        model: The model.
        source: Source of the model, such as an MJCF file (see `stepper.load`), or an `Origin`. None uses the source from which the model
            was loaded.

    Returns:
        The `mujoco.MjModel`; None if the source is unknown.

    Raises:
        LooksError: The source has other bodies, joints or geoms than the model.
    """
    origin = source if isinstance(source, Origin) else Origin(source) if source is not None else origin_of(model)
    if origin is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # These warnings were issued when the model was loaded.
        m = copy.deepcopy(compile_source(origin))
    _check_same(model, m)
    for name in _POSES:
        getattr(m, name)[:] = getattr(model, name)
    sized = sized_geoms(model)
    m.geom_size[sized] = model.geom_size[sized]
    return m


def sized_geoms(model: Model) -> list[int]:
    """Indices of the geoms whose shape is given by `geom_size` (primitives without planes)."""
    return [g for g in range(model.ngeom) if model.geom(g).type in _SIZED]


def _check_same(model: Model, m: Any) -> None:
    """Raises LooksError unless the compiled model `m` of MuJoCo has the same bodies, joints and geoms as stepper's model."""
    mujoco = require("mujoco", "to read colours and meshes of a model")

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
    for kind, (mine, theirs) in compared.items():
        if mine != theirs:
            k = next((k for k, (a, b) in enumerate(zip(mine, theirs, strict=False)) if a != b), min(len(mine), len(theirs)))
            here, there = (", ".join(group[k : k + 1]) or "nothing" for group in (mine, theirs))
            raise LooksError(
                f"the source belongs to another model: {len(theirs)} {kind} and {len(mine)}, number {k} is {there} instead of {here}"
            )


def row(sim: Stepper, name: str, env: int) -> Array:
    """Value of a quantity of a stepper in one environment, (...), in its unit. `env` has no effect with `num_envs=None`."""
    values = np.asarray(getattr(sim, name))
    return values if sim.num_envs is None else values[env]
