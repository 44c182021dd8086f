"""Cartesian control of the hand in panda_trained.py and panda_scripted.py: a target position of the fingers, which point down.

Arm, gripper and cube are those of panda.py. The cube lies at a random place within ±4 cm, and sensors measure its position relative to the
hand.
"""

from __future__ import annotations

import functools
import itertools
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import panda  # type: ignore[import-not-found]  # noqa: E402

SPREAD = 0.04
"""Largest distance of the cube from its nominal position in x and in y, m."""
ABOVE = 0.15
"""Initial height of the fingers above the centre of the cube, m."""
MOVE, HOLD = 0.02, 0.05
"""Largest displacement of the hand's target along each axis per action, m, and duration of an action, s."""
LOW, HIGH = np.array([0.42, -0.08, 0.02]), np.array([0.58, 0.08, 0.25])
"""Bounds of the hand's target, m."""
OPEN = 0.04
"""Joint position of an open finger, m."""


def scene() -> Any:
    """Model of panda.py with the sensors of the policy: position of the hand, of the cube relative to the hand, and of the fingers."""
    spec = panda.drawing()
    for own in [*spec.sensors]:
        spec.delete(own)
    site, kinds = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtSensor
    spec.add_sensor(name="hand", type=kinds.mjSENS_FRAMEPOS, objtype=site, objname="hand_grip_site")
    spec.add_sensor(
        name="cube",
        type=kinds.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname="cube",
        reftype=site,
        refname="hand_grip_site",
    )
    for k in (1, 2):
        joint = f"hand_finger_joint{k}"
        spec.add_sensor(name=f"finger{k}", type=kinds.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
    return spec.compile()


def _terms(place: Any) -> Any:
    """Monomials up to degree 4, (n, 35), of positions (n, 3) scaled to -1 to 1 within the bounds of the target."""
    x = (place - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)
    powers = [p for p in itertools.product(range(5), repeat=3) if sum(p) <= 4]
    return np.stack([np.prod(x**p, axis=1) for p in powers], axis=1)


@functools.cache
def _inverse() -> Any:
    """Polynomial coefficients (35, 7) of the inverse kinematics with fingers that point down, fitted to `panda.reach` on a grid."""
    model, ready = panda.scene(), np.array([0.0, 0.3, 0.0, -2.2, 0.0, 2.5, 0.785])
    middle = panda.reach(model, (LOW + HIGH) / 2, ready, 1e-9)
    grid = np.array(list(itertools.product(*np.linspace(LOW, HIGH, 5).T)))
    angles = np.array([panda.reach(model, place, middle, 1e-9) for place in grid])
    return np.linalg.lstsq(_terms(grid), angles, rcond=None)[0]


def arm(target: Any) -> Any:
    """Joint angles of the arm, (n, 7) rad, that put the fingers at target positions (n, 3), m, pointing down; errors are below 0.5 mm."""
    return _terms(target) @ _inverse()


def controls(target: Any, closed: Any) -> Any:
    """Servo targets of seven joints and two fingers, (n, 9), from the hand's target (n, 3), m, and the closing commands (n,), 0 or 1."""
    finger = np.where(closed, 0.0, OPEN)[:, None]
    return np.concatenate([arm(target), finger, -finger], axis=1)


def moved(target: Any, action: Any) -> Any:
    """New target position of the hand, (n, 3) m: the previous one (n, 3), moved by an action (n, 4) of the policy, within the bounds."""
    return np.clip(target + MOVE * np.clip(action[:, :3], -1.0, 1.0), LOW, HIGH)


def seen(readings: Any, target: Any, closed: Any) -> Any:
    """Observations of the policy, (n, 10).

    Positions of the cube and of the target relative to the hand, height of the hand, positions of both fingers, and closing command.
    """
    hand, rest = readings[:, :3], readings[:, 3:]
    return np.concatenate([rest[:, :3], target - hand, hand[:, 2:], rest[:, 3:5], closed[:, None]], axis=1)


def ready(qpos: Any, aside: Any) -> None:
    """Set initial configurations qpos (n, nq) in place: open fingers above the nominal position, the cube displaced by `aside` (n, 2)."""
    qpos[:, :7] = arm(np.array([[*panda.PLACE, panda.HALF + ABOVE]]))
    qpos[:, 7], qpos[:, 8] = OPEN, -OPEN
    qpos[:, 9:11] += aside


def start(now: Any, rng: Any) -> Any:
    """Initial qpos and qvel: open fingers above the nominal position, the cube within ±4 cm of it."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    ready(qpos, np.array([g.uniform(-SPREAD, SPREAD, 2) for g in rng]))
    return qpos, np.zeros((now.num_envs, now.model.nv))


def picking(name: str, controller: Any, control: float) -> Any:
    """Study of a controller that picks the cube: success is a cube lifted by 10 cm within 4 s.

    Args:
        name: Name of the study.
        controller: The controller.
        control: Control period, s.
    """
    return stepper.lab.Study(
        name=name,
        model=scene,
        controller=controller,
        start=start,
        outcomes=panda.study.outcomes,
        parameters=panda.study.parameters,
        settings=panda.study.settings,
        seconds=4.0,
        control=control,
        episodes=16,
    )
