"""dm_control's hopper: a planar robot of one leg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, randomize_joints, reading, small_control, tolerance
from stepper.envs.task import Array, Reset, TaskView

_HEIGHT = 0.6
"""Height of the torso above the foot at which the robot counts as standing, m."""
_SPEED = 2.0
"""Smallest speed to the right for which the speed term of the reward is 1, m/s."""


@dataclass(frozen=True, kw_only=True)
class Hopper(SuiteTask):
    """Task: stand, or hop to the right.

    Attributes:
        hopping: Whether the task is to hop.
    """

    file = "hopper.xml"
    frame_skip: int = 4
    hopping: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Positions without x, velocities, and log(1 + force) at toe and heel: (15,)."""
        return (
            Observation("position", func=lambda now: now.qpos[:, 1:], unit="m, rad"),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
            Observation("touch", func=lambda now: np.log1p(reading(now, "touch_toe", "touch_heel")), unit="log(1 + N)"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for the torso above the foot, and for speed or small controls."""
        model, centers = now.sim.model, now.xipos
        height = centers[:, model.body("torso").id, 2] - centers[:, model.body("foot").id, 2]
        standing = tolerance(height, _HEIGHT, 2.0)
        if self.hopping:
            speed = reading(now, "torso_subtreelinvel")[:, 0]
            return standing * tolerance(speed, _SPEED, float("inf"), margin=_SPEED / 2.0, fall="linear", value=0.5)
        return standing * (small_control(now) + 4.0) / 5.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random torso angle."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
