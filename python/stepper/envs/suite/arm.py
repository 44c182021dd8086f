"""Planar arm with a hand, shared by dm_control's manipulator and stacker."""

from __future__ import annotations

from collections.abc import Set

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import load_quietly, remove_elements
from stepper.envs.observations import Observation
from stepper.envs.suite.base import reading, source_tree
from stepper.envs.task import Array, TaskView
from stepper.shared.streams import Rng

_JOINTS = ("arm_root", "arm_shoulder", "arm_elbow", "arm_wrist", "finger", "fingertip", "thumb", "thumbtip")
_TOUCH = ("palm_touch", "finger_touch", "thumb_touch", "fingertip_touch", "thumbtip_touch")


def arm_scene(file: str, *, unused: Set[str], placed: Set[str]) -> Model:
    """Model of one of dm_control's files with the arm.

    Args:
        file: Name of the file in the suite.
        unused: Names of bodies to remove.
        placed: Names of bodies that the task places at resets; they become mocap bodies.
    """
    tree = remove_elements(source_tree(file), lambda element: element.tag == "body" and element.get("name") in unused)
    for body in tree.iter("body"):
        if body.get("name") in placed:
            body.set("mocap", "true")
    return load_quietly(tree)


def arm_observations() -> tuple[Observation, ...]:
    """Rows of the observation for angles and velocities of arm and hand, touch sensors, and pose of the hand: (33,)."""
    return (
        Observation("arm_pos", func=_angles),
        Observation("arm_vel", func=lambda now: now.qvel[:, [now.sim.model.joint(name).dofadr for name in _JOINTS]], unit="rad/s"),
        Observation("touch", func=lambda now: np.log1p(reading(now, *_TOUCH)), unit="log(1 + N)"),
        Observation("hand_pos", func=lambda now: pose(now, "hand"), unit="m"),
    )


def draw_arm(model: Model, qpos: Array, rng: Rng) -> None:
    """Draws random angles of the arm within their limits into qpos, (n, nq), rad. Finger and thumb get equal angles."""
    for joint in map(model.joint, _JOINTS):
        low, high = joint.range if joint.limited else (-np.pi, np.pi)
        qpos[:, joint.qposadr] = rng.uniform(low, high, 1)[:, 0]
    qpos[:, model.joint("finger").qposadr] = qpos[:, model.joint("thumb").qposadr]


def pose(now: TaskView, body: str) -> Array:
    """Pose of a body in the plane, (num_envs, 4): x and z (m), and the components w and y of its quaternion."""
    index = now.sim.model.body(body).id
    return np.concatenate([now.xpos[:, index, ::2], now.xquat[:, index, ::2]], axis=1)


def _angles(now: TaskView) -> Array:
    """Sine and cosine of each joint of the arm, (num_envs, 8, 2)."""
    angles = now.qpos[:, [now.sim.model.joint(name).qposadr for name in _JOINTS]]
    return np.stack([np.sin(angles), np.cos(angles)], axis=2)
