"""The hand that panda_trained.py and panda_scripted.py move: a target for its fingers, which point down, in place of the angles of joints.

Arm, gripper and cube are those of panda.py; the cube lies anywhere within 4 cm, and sensors say where it is from the hand.
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
"""m: the cube is this far from its place in x and y at the most."""
ABOVE = 0.15
"""m: the fingers above the cube's middle at the start."""
MOVE, HOLD = 0.02, 0.05
"""m, s: how far an action moves the hand's target along each axis, and how long it is held."""
LOW, HIGH = np.array([0.42, -0.08, 0.02]), np.array([0.58, 0.08, 0.25])
"""m: bounds of the target."""
OPEN = 0.04
"""m: a finger that is open."""


def scene() -> Any:
    """The model of panda.py with what the policy sees: the hand, the cube from the hand, and the fingers."""
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
    """Products of up to four coordinates (n, 3) about the middle of the box: (n, 35)."""
    x = (place - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)
    powers = [p for p in itertools.product(range(5), repeat=3) if sum(p) <= 4]
    return np.stack([np.prod(x**p, axis=1) for p in powers], axis=1)


@functools.cache
def _inverse() -> Any:
    """Coefficients (35, 7) of the arm's angles, which point the fingers down at a place: fitted to damped least squares on a grid."""
    model, ready = panda.scene(), np.array([0.0, 0.3, 0.0, -2.2, 0.0, 2.5, 0.785])
    middle = panda.reach(model, (LOW + HIGH) / 2, ready, 1e-9)
    grid = np.array(list(itertools.product(*np.linspace(LOW, HIGH, 5).T)))
    angles = np.array([panda.reach(model, place, middle, 1e-9) for place in grid])
    return np.linalg.lstsq(_terms(grid), angles, rcond=None)[0]


def arm(target: Any) -> Any:
    """Angles (n, 7) with the fingers at targets (n, 3), pointing down, to half a millimetre."""
    return _terms(target) @ _inverse()


def controls(target: Any, closed: Any) -> Any:
    """Targets of seven joints and two fingers, (n, 9): for the hand's target (n, 3), and whether the fingers close, (n,)."""
    finger = np.where(closed, 0.0, OPEN)[:, None]
    return np.concatenate([arm(target), finger, -finger], axis=1)


def moved(target: Any, action: Any) -> Any:
    """The hand's target (n, 3) after an action (n, 4)."""
    return np.clip(target + MOVE * np.clip(action[:, :3], -1.0, 1.0), LOW, HIGH)


def seen(readings: Any, target: Any, closed: Any) -> Any:
    """What the policy sees, (n, 10): the cube from the hand, the target from the hand, the hand's height, the fingers and their command."""
    hand, rest = readings[:, :3], readings[:, 3:]
    return np.concatenate([rest[:, :3], target - hand, hand[:, 2:], rest[:, 3:5], closed[:, None]], axis=1)


def ready(qpos: Any, aside: Any) -> None:
    """Configurations (n, nq), changed in place: open fingers above the middle, and the cube `aside` (n, 2) of it."""
    qpos[:, :7] = arm(np.array([[*panda.PLACE, panda.HALF + ABOVE]]))
    qpos[:, 7], qpos[:, 8] = OPEN, -OPEN
    qpos[:, 9:11] += aside


def start(now: Any, rng: Any) -> Any:
    """Ready above the middle, the cube anywhere within 4 cm of it."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    ready(qpos, np.array([g.uniform(-SPREAD, SPREAD, 2) for g in rng]))
    return qpos, np.zeros((now.num_envs, now.model.nv))


def picking(name: str, drive: Any, control: float) -> Any:
    """The study of a drive: 4 s, and the cube 10 cm above where it lay."""
    return stepper.lab.Study(
        name=name,
        model=scene,
        drive=drive,
        start=start,
        outcomes=panda.study.outcomes,
        parameters=panda.study.parameters,
        settings=panda.study.settings,
        seconds=4.0,
        control=control,
        episodes=16,
    )
