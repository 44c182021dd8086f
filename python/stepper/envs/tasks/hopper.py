"""Gymnasium's Hopper-v5: a planar leg that hops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stepper.envs.task import Array, Camera, TaskView, all_within, within
from stepper.envs.tasks.walker2d import Walker2d
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Hopper(Walker2d):
    """Task: hop to the right without falling. The arguments are those of Gymnasium's environment.

    Observation, (11,) by default, and reward are those of `Walker2d`.
    """

    camera: ClassVar[Camera] = {"trackbodyid": 2, "distance": 3.0, "lookat": (0.0, 0.0, 1.15), "elevation": -20.0}

    xml_file: str = "hopper.xml"
    frame_skip: int = 4
    healthy_state_range: tuple[float, float] = (-100.0, 100.0)
    healthy_z_range: tuple[float, float] = (0.7, float("inf"))
    healthy_angle_range: tuple[float, float] = (-0.2, 0.2)

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the robot is healthy, (num_envs,) bool.

        The height must be in `healthy_z_range`, and the torso's angle in `healthy_angle_range`. The torso's angle, all joint angles and all
        velocities must be in `healthy_state_range`.
        """
        upright = within(now.qpos[:, 1], self.healthy_z_range) & within(now.qpos[:, 2], self.healthy_angle_range)
        moderate = all_within(now.qpos[:, 2:], self.healthy_state_range) & all_within(now.qvel, self.healthy_state_range)
        healthy: Array = upright & moderate
        return healthy
