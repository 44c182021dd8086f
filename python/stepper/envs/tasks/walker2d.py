"""Gymnasium's Walker2d-v5: a planar walker of two legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum, within
from stepper.envs.tasks.base import NoisyTask
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Walker2d(NoisyTask):
    """Task: walk to the right without falling. The arguments are those of Gymnasium's environment."""

    camera: ClassVar[Camera] = {"trackbodyid": 2, "distance": 4.0, "lookat": (0.0, 0.0, 1.15), "elevation": -20.0}

    xml_file: str = "walker2d_v5.xml"
    frame_skip: int = 4
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 1e-3
    healthy_reward: float = 1.0
    terminate_when_unhealthy: bool = True
    healthy_z_range: tuple[float, float] = (0.8, 2.0)
    healthy_angle_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 5e-3
    exclude_current_positions_from_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (17,) by default: positions, and velocities clipped to 10 m/s and rad/s. The position x is left out by default."""
        return (
            Observation("qpos", columns=slice(int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel", clip=(-10.0, 10.0)),
        )

    def position(self, now: TaskView) -> Array:
        """Position of the robot in x, (num_envs,), m."""
        x: Array = now.qpos[:, 0]
        return x

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the height is within `healthy_z_range` and the angle within `healthy_angle_range`, (num_envs,) bool."""
        healthy: Array = within(now.qpos[:, 1], self.healthy_z_range) & within(now.qpos[:, 2], self.healthy_angle_range)
        return healthy

    def terminated(self, now: TaskView) -> Array | None:
        """Whether each environment is unhealthy, (num_envs,) bool. None (no episode terminates) with `terminate_when_unhealthy=False`."""
        return ~self.healthy(now) if self.terminate_when_unhealthy else None

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x plus a bonus for being healthy, minus a cost of squared controls."""
        forward, survive = self.forward_reward_weight * now.velocity, self.healthy_reward * self.healthy(now)
        control = self.ctrl_cost_weight * square_sum(now.action)
        terms = {"x_velocity": now.velocity, "reward_forward": forward, "reward_ctrl": -control, "reward_survive": survive}
        return forward + survive - control, terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m. The height is measured from the reference pose."""
        return {"x_position": now.qpos[:, 0], "z_distance_from_origin": now.qpos[:, 1] - now.default_qpos[1]}
