"""Planar arm with a hand, shared by dm_control's manipulator and stacker."""

from __future__ import annotations

from collections.abc import Set

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import load_quietly, without
from stepper.envs.streams import Rng
from stepper.envs.suite.base import reading, source_tree
from stepper.envs.task import Array, Moment, Observation

_JOINTS = ("arm_root", "arm_shoulder", "arm_elbow", "arm_wrist", "finger", "fingertip", "thumb", "thumbtip")
_TOUCH = ("palm_touch", "finger_touch", "thumb_touch", "fingertip_touch", "thumbtip_touch")


def arm_scene(file: str, *, unused: Set[str], placed: Set[str]) -> Model:
    """Scene of a file with the arm, without unused bodies. Bodies that a task places are mocap bodies."""
    tree = without(source_tree(file), lambda element: element.tag == "body" and element.get("name") in unused)
    for body in tree.iter("body"):
        if body.get("name") in placed:
            body.set("mocap", "true")
    return load_quietly(tree)


def arm_observations() -> tuple[Observation, ...]:
    """Angles and velocities of arm and hand, and touch sensors: (33,)."""
    return (
        Observation("arm_pos", func=_angles),
        Observation("arm_vel", func=lambda now: now.qvel[:, [now.sim.model.joint(name).dofadr for name in _JOINTS]], unit="rad/s"),
        Observation("touch", func=lambda now: np.log1p(reading(now, *_TOUCH)), unit="log(1 + N)"),
        Observation("hand_pos", func=lambda now: pose(now, "hand"), unit="m"),
    )


def draw_arm(model: Model, qpos: Array, rng: Rng) -> None:
    """Draws random angles within their limits, with equal angles of finger and thumb, into qpos, (n, nq), rad."""
    for joint in map(model.joint, _JOINTS):
        low, high = joint.range if joint.limited else (-np.pi, np.pi)
        qpos[:, joint.qposadr] = rng.uniform(low, high, 1)[:, 0]
    qpos[:, model.joint("finger").qposadr] = qpos[:, model.joint("thumb").qposadr]


def pose(now: Moment, body: str) -> Array:
    """Position of a body in its plane, m, and its orientation, (num_envs, 4)."""
    index = now.sim.model.body(body).id
    return np.concatenate([now.xpos[:, index, ::2], now.xquat[:, index, ::2]], axis=1)


def _angles(now: Moment) -> Array:
    """Sine and cosine of each joint of the arm, (num_envs, 8, 2)."""
    angles = now.qpos[:, [now.sim.model.joint(name).qposadr for name in _JOINTS]]
    return np.stack([np.sin(angles), np.cos(angles)], axis=2)
