"""Pose tasks of MyoSuite: muscles move an elbow or a hand to a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, Reset, Task, TaskView, Terms, square_sum
from stepper.shared.machine import package_file, require

_PURPOSE = "for MyoSuite's tasks, whose models it has"
_FAR = 2.0 * np.pi
"""Distance from the target pose at which an episode ends, rad."""
_NUMERALS = (
    (0.28272, 0.5624, -0.75573, -1.309, 1.30045, -0.006982, 1.45492, 0.998897, 1.26466, 0.0,
     1.40604, 0.227795, 1.07614, -0.020944, 1.46103, 0.06284, 0.83263, -0.14399, 1.571, 1.38248),
    (0.04536, 0.0248, -0.7854, -1.309, 0.366605, 0.010473, 0.269258, 0.111722, 1.48459, 0.0,
     1.45318, 1.44532, 1.44532, -0.204204, 1.46103, 1.44532, 1.48459, -0.2618, 1.47674, 1.48459),
    (0.04536, 0.0248, -0.7854, -1.13447, 0.514973, 0.010473, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 1.44532, -0.204204, 1.46103, 1.44532, 1.48459, -0.2618, 1.47674, 1.48459),
    (0.25305, 0.3384, 0.01569, -0.0262045, 0.645885, 0.010473, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 1.571, -0.036652, 1.52387, 1.45318, 1.40604, -0.068068, 1.39033, 1.571),
    (-0.147495, 0.6392, -0.7854, -1.309, 0.637158, 0.010473, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 0.306345, -0.010472, 0.400605, 0.133535, 0.21994, -0.068068, 0.274925, 0.01571),
    (0.25305, 0.3384, 0.01569, -0.0262045, 0.645885, 0.010473, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 0.306345, -0.010472, 0.400605, 0.133535, 0.21994, -0.068068, 0.274925, 0.01571),
    (-0.147495, 0.6392, -0.7854, -1.309, 0.637158, 0.010473, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 0.306345, -0.010472, 0.400605, 0.133535, 1.1861, -0.2618, 1.35891, 1.48459),
    (0.01569, 0.524, -0.7854, -1.309, 0.645885, -0.006982, 0.128305, 0.111722, 0.510575, 0.0,
     0.37704, 0.117825, 1.28036, -0.115192, 1.52387, 1.45318, 0.432025, -0.068068, 0.18852, 0.149245),
    (0.22338, 0.428, -0.7854, -1.309, 0.645885, -0.006982, 0.128305, 0.194636, 1.39033, 0.0,
     1.08399, 0.573415, 0.667675, -0.020944, 0.0, 0.06284, 0.432025, -0.068068, 0.18852, 0.149245),
    (0.28272, 0.5624, -0.75573, -1.309, 1.30045, -0.006982, 1.45492, 0.998897, 0.39275, 0.0,
     0.18852, 0.227795, 0.667675, -0.020944, 0.0, 0.06284, 0.432025, -0.068068, 0.18852, 0.149245),
)  # fmt: skip
NUMERALS = tuple((0.0, 0.0, 0.0, *angles) for angles in _NUMERALS)
"""Joint angles of the hand, rad, that show the numerals 0 to 9 of the American sign language: MyoSuite's `ASL_qpos` (Apache-2.0)."""


@dataclass(frozen=True, kw_only=True)
class MyoPose(Task):
    """Task of MyoSuite (Caggiano et al. 2022, https://arxiv.org/abs/2205.13600): muscles bring the joints to a target pose.

    Observations, rewards, actions and distributions of initial states are those of MyoSuite's `PoseEnvV0`.

    Attributes:
        limb: Model: "elbow", with one joint and 6 muscles, or "hand", with 23 joints and 39 muscles.
        frame_skip: Time steps (2 ms each) per action.
        target: Target angle of each joint, rad; with `highest`, the lowest target angles.
        highest: Highest target angles. Each episode then draws targets between `target` and `highest`. None keeps `target`.
        near: Distance from the target below which the pose counts as solved, rad.
        random_start: Whether episodes begin with random joint angles within their ranges; otherwise at the model's reference pose.
    """

    contact = "mujoco"
    camera: ClassVar[Camera] = {"distance": 1.2}
    episode_steps: ClassVar[int] = 100
    """Number of actions per episode."""
    limb: Literal["elbow", "hand"]
    frame_skip: int = 10
    target: tuple[float, ...]
    highest: tuple[float, ...] | None = None
    near: float = 0.35
    random_start: bool = False

    def model(self) -> Model:
        """Model of the limb, from the package myo_sim.

        Raises:
            MissingPackageError: myo_sim is not installed.
        """
        return _limb(self.limb)

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """Bounds of the actions: -1 to 1 for each muscle. An action a excites a muscle by 1 / (1 + exp(-5 (a - 1/2)))."""
        return -np.ones(model.nu), np.ones(model.nu)

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, joint velocities times the time of an action, angles from the pose to the target, activations: 9, or 108."""
        return (
            Observation("qpos"),
            Observation("motion", func=lambda now: now.qvel * (self.frame_skip * now.sim.timestep), unit="rad"),
            Observation("pose_err", func=_error, unit="rad"),
            Observation("act"),
        )

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: minus the distance d from the target, 4 each for d < near and d < 1.5 near, minus the mean activation, minus 50 if far.

        The mean activation is the norm of the activations divided by their number. The info has the weighted terms, and "solved": 1 for
        d < near, else 0.
        """
        distance = _distance(now)
        terms = {
            "pose": -distance,
            "bonus": 4.0 * (distance < self.near) + 4.0 * (distance < 1.5 * self.near),
            "act_reg": -np.sqrt(square_sum(now.act)) / now.act.shape[1],
            "penalty": -50.0 * (distance > _FAR),
        }
        reward: Array = sum(terms.values(), np.zeros(len(distance)))
        return reward, terms | {"solved": np.where(distance < self.near, 1.0, 0.0)}

    def terminated(self, now: TaskView) -> Array:
        """Whether the distance from the target is more than 2 pi."""
        far: Array = _distance(now) > _FAR
        return far

    def episode_state(self, num_envs: int) -> Terms:
        """Target angle of each joint, rad, as "target"."""
        return {"target": np.tile(np.array(self.target), (num_envs, 1))}

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, at the reference pose or at random angles, with a target between the ends of its range."""
        if self.highest is not None:
            low, high = np.array(self.target), np.array(self.highest)
            reset.episode_state["target"] = low + (high - low) * reset.rng.uniform(0.0, 1.0, len(low))
        if self.random_start:
            low, high = self.model().jnt_range.T
            reset.qpos[:] = low + (high - low) * reset.rng.uniform(0.0, 1.0, len(low))

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action, with the excitations of the muscles."""
        action = np.clip(now.action, -1.0, 1.0)
        now.sim.step(1.0 / (1.0 + np.exp(-5.0 * (action - 0.5))), self.frame_skip)


def _error(now: TaskView) -> Array:
    """Angles from the pose to the target, rad: (num_envs, njnt)."""
    error: Array = now.episode_state["target"] - now.qpos
    return error


def _distance(now: TaskView) -> Array:
    """Distance of the pose from the target, rad: (num_envs,)."""
    distance: Array = np.sqrt(square_sum(_error(now)))
    return distance


@cache_model
def _limb(limb: str) -> Model:
    """Model of a limb."""
    if limb == "elbow":
        return load_quietly(package_file("myo_sim", "models/legacy/elbow/myoelbow_1dof6muscles.xml", _PURPOSE))
    hand = require("myo_sim.build.compose", _PURPOSE).build_right_hand_from_arm_spec()
    root = hand.body("myoarm_r_root")
    # The frame in which MyoSuite 3 puts the hand.
    root.pos, root.quat = [-0.02525155, 0.07146933, 1.39249298], [0.52167746, 0.46981366, -0.47875126, -0.52718591]
    return load_quietly(hand)
