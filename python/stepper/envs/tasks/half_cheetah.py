"""Gymnasium's HalfCheetah-v5: a planar runner of two legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum
from stepper.envs.tasks.base import NoisyTask


@dataclass(frozen=True, kw_only=True)
class HalfCheetah(NoisyTask):
    """Task: run to the right with small controls. The arguments are those of Gymnasium's environment. An episode never terminates."""

    camera: ClassVar[Camera] = {"distance": 4.0}
    normal_velocities: ClassVar[bool] = True

    xml_file: str = "half_cheetah.xml"
    frame_skip: int = 5
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.1
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (17,) by default: positions and velocities. The position x is left out by default."""
        return (
            Observation("qpos", columns=slice(int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel"),
        )

    def position(self, now: TaskView) -> Array:
        """Position of the robot in x, (num_envs,), m."""
        x: Array = now.qpos[:, 0]
        return x

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x minus a cost of squared controls."""
        forward = self.forward_reward_weight * now.velocity
        control = self.ctrl_cost_weight * square_sum(now.action)
        return forward - control, {"x_velocity": now.velocity, "reward_forward": forward, "reward_ctrl": -control}

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m."""
        return {"x_position": now.qpos[:, 0]}
