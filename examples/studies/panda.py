"""Scripted picking of a cube by a Panda arm: friction at which the cube slips, for several solver settings, contact laws and engines.

The arm and the gripper are robosuite's (`pip install --no-deps robosuite`), with position servos. A script moves the hand above the cube
and down, closes the fingers, and lifts by 15 cm. Each finger presses with 20 N, plus or minus 1 N of dry joint friction. The study varies
the friction of cube and fingers together:

    stepper report examples/studies/panda.py

panda_trained.py has a learned policy instead of the script.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper

MASS, HALF = 1.6, 0.025
"""Mass of the cube, kg, and half its edge length, m."""
PLACE = (0.5, 0.0)
"""Position of the cube in x and y, m."""
G, FORCE = 9.81, 20.0
"""Gravity, m/s^2, and force bound of a finger's servo, N."""
RISE = 0.15
"""Height of the lift, m."""
DRY = 1.0
"""Dry friction of a finger's joint, N. It can add to the pressing force or reduce it."""
THEORY = MASS * G / (2.0 * (FORCE + DRY)), MASS * (G + 6 * RISE) / (2.0 * (FORCE - DRY))
"""Bounds of the friction threshold, 0.374 and 0.451.

Below the first, the cube slips even when the hand holds still. Above the second, it does not slip even at the beginning of the lift, whose
acceleration is 6 RISE / s^2.
"""
TIMES, HEIGHTS = (0.0, 0.6, 1.2, 1.6, 2.6, 3.2), (0.15, 0.15, 0.0, 0.0, RISE, RISE)
"""Waypoints of the fingers: times, s, and heights above the centre of the cube, m. The fingers close from 1.2 s to 1.6 s."""


def _assets() -> Path:
    """Folder with the model files of the package robosuite."""
    found = importlib.util.find_spec("robosuite")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("package robosuite, which has the model of the Panda, is missing: pip install --no-deps robosuite")
    return Path(found.origin).parent / "models/assets"


def drawing() -> Any:
    """Model specification (`MjSpec`) of arm, gripper, floor and cube."""
    arm = mujoco.MjSpec.from_file(str(_assets() / "robots/panda/robot.xml"))
    hand = mujoco.MjSpec.from_file(str(_assets() / "grippers/panda_gripper.xml"))
    for spec in (arm, hand):
        for geom in [*spec.geoms]:
            if geom.contype == 0 and geom.conaffinity == 0:
                spec.delete(geom)
    hold = next(body for body in arm.bodies if body.name == "right_hand")
    hold.add_frame().attach_body(hand.body("right_gripper"), "hand_", "")
    for body in arm.bodies:
        body.gravcomp = 1.0
    for motor in arm.actuators:
        if motor.name.startswith("torq"):
            motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
            motor.gainprm[0], motor.biasprm[1], motor.biasprm[2] = 2000.0, -2000.0, -200.0
            motor.ctrllimited, motor.forcerange = False, motor.ctrlrange
    world = arm.worldbody
    world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 1])
    cube = world.add_body(name="cube", pos=[*PLACE, HALF], gravcomp=0.0)
    cube.add_freejoint()
    cube.add_geom(name="cube", type=mujoco.mjtGeom.mjGEOM_BOX, size=[HALF] * 3, mass=MASS)
    arm.option.timestep = 0.002
    return arm


def scene() -> Any:
    """Compiled MuJoCo model of the scene."""
    return drawing().compile()


def reach(model: Any, place: Any, begin: Any, close: float = 0.0) -> Any:
    """Joint angles (7,), rad, with which the arm holds the fingers at the position `place`, (3,), m, pointing down.

    Inverse kinematics by damped least squares from the angles `begin`, until the error (m, rad) is below `close`.
    """
    data, site = mujoco.MjData(model), model.site("hand_grip_site").id
    data.qpos[:7] = begin
    down = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    jacobian = np.zeros((6, model.nv))
    for _ in range(300):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        now = data.site_xmat[site].reshape(3, 3)
        turn = 0.5 * np.cross(now, down, axisa=0, axisb=0, axisc=0).sum(axis=1)
        error = np.concatenate([place - data.site_xpos[site], turn])
        if np.abs(error).max() < close:
            break
        j = jacobian[:, :7]
        data.qpos[:7] += j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), error)
    if np.abs(error).max() > 1e-5:
        raise ValueError(f"the arm does not reach {place}, error {error} (m, rad): give a position within its workspace")
    return data.qpos[:7].copy()


def way(time: float) -> tuple[int, float]:
    """Progress of the scripted motion at a time, s: index of the current segment between two waypoints, and its finished fraction.

    Each segment begins and ends at rest.
    """
    k = min(max(0, int(np.searchsorted(TIMES, time, side="right")) - 1), len(TIMES) - 2)
    s = float(np.clip((time - TIMES[k]) / (TIMES[k + 1] - TIMES[k]), 0.0, 1.0))
    return k, 3 * s**2 - 2 * s**3


class Pick:
    """Scripted controller that interpolates joint angles between the waypoints."""

    def __init__(self) -> None:
        model, ready = scene(), np.array([0.0, 0.3, 0.0, -2.2, 0.0, 2.5, 0.785])
        self.angles = []
        for height in HEIGHTS:
            ready = reach(model, np.array([*PLACE, HALF + height]), ready)
            self.angles.append(ready)

    def arm(self, time: float) -> Any:
        """Joint angles of the arm on the scripted motion at a time, s: (7,), rad."""
        k, done = way(time)
        return self.angles[k] + done * (self.angles[k + 1] - self.angles[k])

    def __call__(self, now: Any) -> Any:
        """Servo targets at the present time, (9,): angles of seven joints (rad) and positions of two fingers (m)."""
        closed = now.time[0] >= TIMES[2]
        return np.array([*self.arm(now.time[0]), *((0.0, 0.0) if closed else (0.04, -0.04))])


pick = Pick()


def start(now: Any, _: Any) -> Any:
    """Initial qpos and qvel: at rest, with open fingers above the cube."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    qpos[:, :7], qpos[:, 7], qpos[:, 8] = pick.angles[0], 0.04, -0.04
    return qpos, np.zeros((now.num_envs, now.model.nv))


study = stepper.lab.Study(
    name="panda",
    model=scene,
    controller=pick,
    start=start,
    outcomes=[
        stepper.lab.Outcome(name="rise", measure="body cube z", reduce="change", success=">= 0.1", unit="m"),
        stepper.lab.Outcome(
            name="slip",
            measure=lambda now: now.read("site_xpos", "hand_grip_site")[:, 2] - now.read("xpos", "cube")[:, 2],
            reduce="end",
            unit="m",
        ),
    ],
    parameters={
        "friction": stepper.lab.Parameter(
            "geom_friction[cube,hand_finger*][0]",
            values=(0.3, 0.4, 0.5, 0.7, 0.95, 1.2),
            source="range of the task, 0.3 to 1.2",
        )
    },
    settings={
        **{f"{count} iterations": {"iterations": count} for count in (20, 10, 5)},
        **{f"MuJoCo's law, {count} iterations": {"contact": "mujoco", "iterations": count} for count in (20, 10, 5)},
        **{f"MuJoCo, {count} iterations": {"engine": "mujoco", "iterations": count} for count in (20, 10, 5)},
    },
    seconds=3.2,
    control=0.02,
    episodes=1,
)
