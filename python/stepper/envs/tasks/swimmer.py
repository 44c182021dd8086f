"""Gymnasium's Swimmer-v5: a planar chain in a viscous medium."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum
from stepper.envs.tasks.base import NoisyTask


@dataclass(frozen=True, kw_only=True)
class Swimmer(NoisyTask):
    """Task: swim in x with small controls. The arguments are those of Gymnasium's environment. An episode never terminates."""

    camera: ClassVar[Camera] = {"distance": 8.0}
    xml_file: str = "swimmer.xml"
    frame_skip: int = 4
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 1e-4
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (8,) by default: positions and velocities. The positions x and y are left out by default."""
        return (
            Observation("qpos", columns=slice(2 * int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel"),
        )

    def position(self, now: TaskView) -> Array:
        """Position of the robot in x and y, (num_envs, 2), m."""
        xy: Array = now.qpos[:, :2]
        return xy

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x minus a cost of squared controls."""
        x_velocity, y_velocity = now.velocity.T
        forward = self.forward_reward_weight * x_velocity
        control = self.ctrl_cost_weight * square_sum(now.action)
        terms = {"x_velocity": x_velocity, "y_velocity": y_velocity, "reward_forward": forward, "reward_ctrl": -control}
        return forward - control, terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m."""
        x, y = now.qpos[:, :2].T
        return {"x_position": x, "y_position": y, "distance_from_origin": np.hypot(x, y)}
