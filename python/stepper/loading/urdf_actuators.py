"""Actuators for the joints of a URDF, a format without actuators (argument `actuators` of `stepper.load`)."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any, Literal

import numpy as np

from stepper._stepper import ModelError
from stepper.loading.urdf_elements import Urdf

Actuators = Literal["position", "velocity", "torque"]
KINDS: tuple[Actuators, ...] = ("position", "velocity", "torque")
_MOVABLE = ("revolute", "continuous", "prismatic")

POSITION_FREQUENCY = 5.0
"""Natural frequency of a position servo, Hz. Gravity deflects a rod of length l by at most 1.5 g / (l w^2), w = 2 pi times
this frequency: 0.03 rad for 0.5 m."""

FULL_EFFORT_ERROR = 0.25
"""Largest error at which a position servo of a robot with a free base reaches its effort limit, rad.

The stiffness from `POSITION_FREQUENCY` is for the links beyond a joint, and a leg that stands also carries the rest of the robot.
`examples/quadruped.urdf`: joints deflect by up to 1.1 rad without this bound, and by 0.06 rad with it."""

VELOCITY_FREQUENCY = 50.0
"""Bandwidth of a velocity servo, Hz: ten times that of the position servo, as usual for the inner loop of a cascade. With control 0,
gravity turns a rod of length l at a speed of at most 1.5 g / (l w), w = 2 pi times this frequency: 0.09 rad/s for 0.5 m."""


def add_actuators(kind: Actuators, urdf: Urdf, compiled: Any, description: dict[str, Any], *, free_base: bool = False) -> None:
    """Adds an actuator to every hinge and slide of a description, except to joints that follow another one (`mimic`).

    Args:
        kind: Kind of the actuators. I is a joint's effective inertia at the reference pose with all other joints held.

            * "position": servo with stiffness k = I w^2 and critical damping d = 2 sqrt(k I), where w = 2 pi `POSITION_FREQUENCY`.
              With a free base, k of a hinge is at least its effort limit divided by `FULL_EFFORT_ERROR`.
            * "velocity": servo with damping d = I w, where w = 2 pi `VELOCITY_FREQUENCY`.
            * "torque": motor.

            Control ranges are the position, velocity or effort limits of the file; force ranges are the effort limits.
        urdf: The URDF.
        compiled: The `mujoco.MjModel` that was compiled from the URDF.
        description: Description to which the actuators are added.
        free_base: Whether the root link has a free joint.
    """
    if urdf.root is None:
        raise ModelError(f"{urdf.place}: actuators={kind!r} needs the joint limits, and the XML is not well-formed; correct the file")
    names = [joint["name"] for joint in description["joints"]]
    driven = [name for name in names if name in urdf.joints and _can_drive(urdf, name)]
    if not driven:
        raise ModelError(
            f"{urdf.place}: actuators={kind!r}, and the file has no revolute, continuous or prismatic joint; omit the argument actuators"
        )
    mass = _mass_matrix(compiled)
    for name in driven:
        joint = names.index(name)
        inertia = _effective_inertia(mass, compiled, urdf, names, name)
        description["actuators"].append(_actuator(kind, urdf, description["joints"][joint], joint, inertia, free_base=free_base))
        if kind == "velocity" and urdf.speed_limit(name) is None:
            description["omitted"].append(_unbounded(name, "velocity"))
        if kind == "torque" and urdf.effort_limit(name) is None:
            description["omitted"].append(_unbounded(name, "effort"))


def _can_drive(urdf: Urdf, name: str) -> bool:
    """Whether a joint is a hinge or slide that does not follow another joint."""
    joint = urdf.joints[name]
    return joint.get("type") in _MOVABLE and joint.find("mimic") is None


def _unbounded(name: str, limit: str) -> dict[str, Any]:
    """Entry for `Model.omitted` about a joint without a "velocity" or "effort" limit, whose actuator has unbounded controls."""
    reason = f"the file has no {limit} limit, so the control is unbounded; model.replace(actuator_ctrlrange=...) sets bounds"
    return {"kind": f"URDF {limit} limit", "name": name, "reason": reason, "changes_motion": False}


def _mass_matrix(compiled: Any) -> np.ndarray[Any, Any]:
    """Mass matrix of a compiled `mujoco.MjModel` at `qpos0`, (nv, nv)."""
    mujoco = import_module("mujoco")
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    mass = np.zeros((compiled.nv, compiled.nv))
    mujoco.mj_fullM(compiled, data, mass)
    return mass


def _effective_inertia(mass: np.ndarray[Any, Any], compiled: Any, urdf: Urdf, names: list[str], name: str) -> float:
    """Effective inertia of a joint, kg m^2 or kg. Joints that follow the joint (`mimic`) move too; all others are held."""
    motion = np.zeros(compiled.nv)
    motion[compiled.jnt_dofadr[names.index(name)]] = 1.0
    for other, element in urdf.joints.items():
        mimic = element.find("mimic")
        if mimic is not None and mimic.get("joint") == name and other in names:
            multiplier = urdf.number(other, "mimic", "multiplier")
            motion[compiled.jnt_dofadr[names.index(other)]] = 1.0 if multiplier is None else multiplier
    return float(motion @ mass @ motion)


def _actuator(kind: Actuators, urdf: Urdf, joint: dict[str, Any], index: int, inertia: float, *, free_base: bool) -> dict[str, Any]:
    """Actuator of a joint as a dictionary for the Rust library."""
    effort, speed = urdf.effort_limit(joint["name"]), urdf.speed_limit(joint["name"])
    position, velocity = 2 * math.pi * POSITION_FREQUENCY, 2 * math.pi * VELOCITY_FREQUENCY
    stiffness = inertia * position**2
    if free_base and effort is not None and urdf.joints[joint["name"]].get("type") != "prismatic":
        stiffness = max(stiffness, effort / FULL_EFFORT_ERROR)
    damping = 2 * math.sqrt(stiffness * inertia)
    gain, bias, bounds = {
        "position": (stiffness, [0.0, -stiffness, -damping], joint["range"]),
        "velocity": (inertia * velocity, [0.0, 0.0, -inertia * velocity], _symmetric(speed)),
        "torque": (1.0, [0.0, 0.0, 0.0], _symmetric(effort)),
    }[kind]
    return {
        "name": joint["name"],
        "transmission": {"Joint": index},
        "gear": 1.0,
        "delay": 0.0,
        "delay_holds": True,
        "ctrl_range": bounds,
        "force_range": _symmetric(effort),
        "act_range": None,
        "activation": "None",
        "gain": [gain, 0.0, 0.0],
        "bias": bias,
        "force_model": {"gain": "Fixed", "bias": "Affine" if any(bias) else "None", "disabled": False},
    }


def _symmetric(limit: float | None) -> list[float] | None:
    """Range [-limit, limit]; None without a limit."""
    return None if limit is None else [-limit, limit]
