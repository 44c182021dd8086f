"""dm_control's quadruped, on flat ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly, remove_elements
from stepper.envs.observations import Observation
from stepper.envs.suite.base import (
    SuiteTask,
    hinges,
    lift_until_free,
    norm,
    open_floor,
    reading,
    rotation,
    source_tree,
    tolerance,
)
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.rotations import about_vertical

_TOES = ("front_left", "front_right", "back_right", "back_left")
_EPISODE = 20.0
"""Duration of an episode, s."""
_ARENA = 15.0
"""Half the side of the arena in which the ball is fetched, m."""
_BALL = {("body", "ball"), ("site", "target")}
"""Elements of the file that belong to the ball: tag and name of each."""
_WORKSPACE, _TARGET = 0.3, 0.4
"""Radius of the zone in front of the robot within which the ball counts as reached, and radius of the target, m."""


@dataclass(frozen=True, kw_only=True)
class Quadruped(SuiteTask):
    """Task: move forwards, or fetch a ball.

    Sensors are those of stepper. The accelerometer and the touch sensors of the toes use the mean acceleration (v+ - v) / h over the last
    step, in the pose after it. The sensors of dm_control use the acceleration before that step, without implicit joint damping.

    Attributes:
        move_speed: Forward speed that earns the full reward of 1, m/s.
        fetch: Whether the task is to bring a ball to the middle.
    """

    file = "quadruped.xml"
    frame_skip: int = 4
    move_speed: float = 0.5
    fetch: bool = False

    def model(self) -> Model:
        """Model of the scene, without terrain and range finders.

        In tasks without a ball, half the side of the floor is the distance that the robot covers in an episode at the rewarded speed.
        """
        return _scene(None if self.fetch else self.move_speed * _EPISODE)

    def observations(self) -> tuple[Observation, ...]:
        """Angles and velocities of the hinges, activations, state of the torso, and forces and torques at the toes: (78,).

        The state of the torso is its velocity, the vertical component of its z axis, and the readings of its accelerometer and gyro. If the
        task is to fetch, the states of ball and target follow: (90,).
        """
        rows = (
            Observation("egocentric_state", func=_egocentric_state, unit="rad, rad/s"),
            Observation("torso_velocity", func=lambda now: reading(now, "velocimeter"), unit="m/s"),
            Observation("torso_upright", func=lambda now: rotation(now, "torso")[:, 2, 2]),
            Observation("accelerometer", func=lambda now: reading(now, "imu_accel"), unit="m/s^2"),
            Observation("gyro", func=lambda now: reading(now, "imu_gyro"), unit="rad/s"),
            Observation("force_torque", func=_at_the_toes, unit="arsinh(N), arsinh(N m)"),
        )
        if not self.fetch:
            return rows
        return (*rows, Observation("ball_state", func=_ball, unit="m, m/s, rad/s"), Observation("target_position", func=_target, unit="m"))

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for an upright torso, and for speed or for the positions of robot and ball."""
        upright = tolerance(rotation(now, "torso")[:, 2, 2], 1.0, float("inf"), margin=2.0, fall="linear", value=0.0)
        if not self.fetch:
            speed, wanted = reading(now, "velocimeter")[:, 0], self.move_speed
            return upright * tolerance(speed, wanted, float("inf"), margin=wanted, fall="linear", value=0.5)
        model, ball = now.sim.model, _body_position(now, "ball")
        radii = {"workspace": _WORKSPACE + float(model.geom("ball").size[0]), "target": _TARGET}
        distances = {site: norm((now.site_xpos[:, model.site(site).id] - ball)[:, :2]) for site in radii}
        near, brought = (
            tolerance(distances[site], 0.0, radius, margin=np.sqrt(2.0) * _ARENA, fall="linear", value=0.0)
            for site, radius in radii.items()
        )
        reward: Array = upright * near * (0.5 + 0.5 * brought)
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest just above the ground with a random orientation.

        If the task is to fetch, the robot starts upright with a random heading, and the ball is in flight.
        """
        model = self.model()
        at = model.joint("root").qposadr
        if not self.fetch:
            quat = reset.rng.normal(4)
            reset.qpos[:, at + 3 : at + 7] = quat / norm(quat)[:, None]
            lift_until_free(model, reset.qpos, at + 2)
            return
        reset.qpos[:, at + 3 : at + 7] = about_vertical(reset.rng.uniform(0.0, 2.0 * np.pi, 1)[:, 0])
        reset.qpos[:, at : at + 2] = reset.rng.uniform(-0.9 * _ARENA, 0.9 * _ARENA, 2)
        lift_until_free(model, reset.qpos, at + 2)
        ball = model.joint("ball_root")
        reset.qpos[:, ball.qposadr : ball.qposadr + 2] = reset.rng.uniform(-0.9 * _ARENA, 0.9 * _ARENA, 2)
        reset.qpos[:, ball.qposadr + 2] = 2.0
        reset.qvel[:, ball.dofadr : ball.dofadr + 2] = 5.0 * reset.rng.normal(2)


def _egocentric_state(now: TaskView) -> Array:
    """Angles and velocities of the hinges, activations: (num_envs, 44)."""
    joints = hinges(now.sim.model)
    angles, rates = now.qpos[:, [joint.qposadr for joint in joints]], now.qvel[:, [joint.dofadr for joint in joints]]
    return np.concatenate([angles, rates, now.act], axis=1)


def _at_the_toes(now: TaskView) -> Array:
    """Inverse hyperbolic sines of the forces (N) and torques (N m) measured at the toes: (num_envs, 24)."""
    loads: Array = np.arcsinh(reading(now, *(f"{kind}_toe_{toe}" for kind in ("force", "torque") for toe in _TOES)))
    return loads


def _ball(now: TaskView) -> Array:
    """Position, velocity and angular velocity of the ball, one per row, in the frame of the torso: (num_envs, 3, 3).

    Position (m) and velocity (m/s) are relative to the torso. The angular velocity (rad/s) is rotated as in dm_control, which treats its
    components in the frame of the ball (`qvel`) as components in world axes.
    """
    ball, root = now.sim.model.joint("ball_root").dofadr, now.sim.model.joint("root").dofadr
    rows = [
        _body_position(now, "ball") - _body_position(now, "torso"),
        now.qvel[:, ball : ball + 3] - now.qvel[:, root : root + 3],
        now.qvel[:, ball + 3 : ball + 6],
    ]
    state: Array = np.einsum("nki,nij->nkj", np.stack(rows, axis=1), rotation(now, "torso"))
    return state


def _target(now: TaskView) -> Array:
    """Position of the site `target`, at the middle of the floor, relative to the torso and in its frame, (num_envs, 3), m."""
    offset = now.site_xpos[:, now.sim.model.site("target").id] - _body_position(now, "torso")
    local: Array = np.einsum("ni,nij->nj", offset, rotation(now, "torso"))
    return local


def _body_position(now: TaskView, body: str) -> Array:
    """Position of a body by name, in world axes, (num_envs, 3), m."""
    place: Array = now.xpos[:, now.sim.model.body(body).id]
    return place


@cache_model
def _scene(floor: float | None) -> Model:
    """Model of the quadruped on a square floor without walls and ball.

    `floor` is half the side of the floor, m. None keeps the arena with walls and ball.
    """
    tree = remove_elements(source_tree(Quadruped.file), lambda element: element.tag == "rangefinder" or element.get("type") == "hfield")
    return load_quietly(tree if floor is None else open_floor(tree, floor, _BALL))
