"""dm_control's cheetah: a planar runner of two legs."""

from __future__ import annotations

from dataclasses import dataclass

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, randomize_joints, reading, settle, tolerance
from stepper.envs.task import Array, Reset, TaskView

_SPEED = 10.0
"""Speed at and above which the reward is 1, m/s."""


@dataclass(frozen=True, kw_only=True)
class Cheetah(SuiteTask):
    """Task: run to the right, at 10 m/s or faster."""

    file = "cheetah.xml"
    frame_skip: int = 1

    def observations(self) -> tuple[Observation, ...]:
        """Positions without x, and velocities: (17,)."""
        return (
            Observation("position", func=lambda now: now.qpos[:, 1:], unit="m, rad"),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: velocity of the centre of mass in x divided by 10 m/s, clipped to the range from 0 to 1."""
        return tolerance(reading(now, "torso_subtreelinvel")[:, 0], _SPEED, float("inf"), margin=_SPEED, fall="linear", value=0.0)

    def reset(self, reset: Reset) -> None:
        """Initial states: those in which the robot lies after 200 steps without controls from random angles of limited joints."""
        root = reset.qpos[:, :3].copy()
        randomize_joints(self.model(), reset.qpos, reset.rng)
        reset.qpos[:, :3] = root
        settle(reset, 200)
