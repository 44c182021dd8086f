"""dm_control's planar manipulator: an arm with a hand that brings a ball or a peg to a target, or puts it into a receptacle."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import cache_model, load_quietly, remove_elements
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, overlapping, reading, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.rotations import matrices
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


_PROPS = {"ball", "target_ball", "cup", "peg", "target_peg", "slot"}
"""Names of the objects, targets and receptacles, which are bodies in dm_control's file. A task removes the bodies that it does not use."""
_CLOSE = 0.01
"""Distance within which two sites count as being at the same place, m."""
_IN_HAND, _IN_TARGET = 0.1, 0.1
"""Probability that an episode starts with the object in the hand, and probability that it starts with the object at the target."""


@dataclass(frozen=True, kw_only=True)
class Manipulator(SuiteTask):
    """Task: bring an object to a target. Targets and receptacles are mocap bodies, with random poses in each episode.

    Attributes:
        peg: Whether the object is a peg; a ball otherwise.
        insert: Whether the target is in a receptacle: a slot for the peg, a cup for the ball.
    """

    file = "manipulator.xml"
    frame_skip: int = 10
    peg: bool = False
    insert: bool = False

    @property
    def _object(self) -> str:
        """Name of the body that must be brought to the target: "ball" or "peg"."""
        return "peg" if self.peg else "ball"

    def model(self) -> Model:
        """Model of the arm with the objects of this task."""
        return _scene(self.peg, self.insert)

    def observations(self) -> tuple[Observation, ...]:
        """Arm and hand, touch sensors, object and target: (44,)."""
        thing = self._object
        return (
            *arm_observations(),
            Observation("object_pos", func=lambda now: pose(now, thing), unit="m"),
            Observation(
                "object_vel", func=lambda now: now.qvel[:, [now.sim.model.joint(f"{thing}_{k}").dofadr for k in "xzy"]], unit="m/s, rad/s"
            ),
            Observation("target_pos", func=lambda now: pose(now, f"target_{thing}"), unit="m"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the object at the target. With a peg, a hand in the grasp pose at the peg earns up to 1/3."""
        if not self.peg:
            return _closeness(now, "ball", "target_ball")
        grasping = (_closeness(now, "peg_grasp", "grasp") + _closeness(now, "peg_pinch", "pinch")) / 2.0
        bringing = (_closeness(now, "peg", "target_peg") + _closeness(now, "peg_tip", "target_peg_tip")) / 2.0
        reward: Array = np.maximum(bringing, grasping / 3.0)
        return reward

    def reset(self, reset: Reset) -> None:
        """Draws poses of arm, target and object until no geoms overlap. The object starts in the hand, at the target, or in flight."""
        model, count = reset.sim.model, len(reset.envs)
        target = np.zeros((count, 3))
        again = np.ones(count, dtype=bool)
        while again.any():
            some, rates = reset.qpos[again], reset.qvel[again]
            target[again] = self._draw(model, some, rates, reset.rng.of(again))
            reset.qpos[again], reset.qvel[again] = some, rates
            again[again] = overlapping(model, some, *_posed(model, target[again]))
        reset.mocap_pos, reset.mocap_quat = _posed(model, target)

    def _draw(self, model: Model, qpos: Array, qvel: Array, rng: Rng) -> Array:
        """Draws positions and velocities into qpos (n, nq) and qvel (n, nv), and returns x, z (m) and angle (rad) of the target, (n, 3)."""
        draw_arm(model, qpos, rng)
        widest = np.pi / 3.0 if self.insert else np.pi
        target = np.hstack([rng.uniform(-0.4, 0.4, 1), rng.uniform(0.1, 0.4, 1), rng.uniform(-widest, widest, 1)])
        kind = rng.uniform(0.0, 1.0, 1)[:, 0]
        in_hand, in_target = kind < _IN_HAND, (kind >= _IN_HAND) & (kind < _IN_HAND + _IN_TARGET)
        drawn = np.hstack([rng.uniform(-0.5, 0.5, 1), rng.uniform(0.0, 0.7, 1), rng.uniform(0.0, 2.0 * np.pi, 1)])
        speed = rng.uniform(-5.0, 5.0, 1)[:, 0]
        drawn[in_target] = target[in_target]
        if in_hand.any():
            drawn[in_hand] = _grasp(model, qpos[in_hand])
        flies = ~(in_hand | in_target)
        qvel[flies, model.joint(f"{self._object}_x").dofadr] = speed[flies]
        qpos[:, [model.joint(f"{self._object}_{k}").qposadr for k in "xzy"]] = drawn
        return target


def _closeness(now: TaskView, one: str, other: str) -> Array:
    """Score of the distance of two sites, (num_envs,): 1 within 0.01 m, decreasing with the distance."""
    places = [now.site_xpos[:, now.sim.model.site(name).id] for name in (one, other)]
    return tolerance(norm(places[0] - places[1]), 0.0, _CLOSE, margin=2.0 * _CLOSE)


def _grasp(model: Model, qpos: Array) -> Array:
    """Poses of an object in the grasp of the hand, for configurations qpos (n, nq): x, z (m) and angle (rad), (n, 3)."""
    probe, site = Stepper(model, len(qpos)), model.site("grasp").id
    probe.reset(qpos=qpos)
    across = matrices(np.asarray(probe.site_xquat)[:, site])[:, :, 0]
    return np.column_stack([np.asarray(probe.site_xpos)[:, site, ::2], np.pi - np.arctan2(across[:, 2], across[:, 0])])


def _posed(model: Model, target: Array) -> tuple[Array, Array]:
    """Positions (n, nmocap, 3), m, and quaternions (n, nmocap, 4) of target and receptacle (mocap bodies).

    They are for poses of the target, (n, 3): x, z (m) and angle (rad).
    """
    bodies = [body for body in map(model.body, range(model.nbody)) if body.mocapid >= 0]
    place, quat = np.zeros((len(target), len(bodies), 3)), np.zeros((len(target), len(bodies), 4))
    for body in bodies:
        # y is normal to the plane of the arm, and keeps its value in the file.
        place[:, body.mocapid] = np.column_stack([target[:, 0], np.full(len(target), body.pos[1]), target[:, 1]])
        quat[:, body.mocapid, 0], quat[:, body.mocapid, 2] = np.cos(target[:, 2] / 2.0), np.sin(target[:, 2] / 2.0)
    return place, quat


@cache_model
def _scene(peg: bool, insert: bool) -> Model:
    """Model of the arm with the objects of one task; target and receptacle are mocap bodies."""
    placed = {"target_peg" if peg else "target_ball"} | ({"slot" if peg else "cup"} if insert else set())
    return arm_scene(Manipulator.file, unused=_PROPS - placed - {"peg" if peg else "ball"}, placed=placed)
