"""dm_control's cheetah, hopper and walker: planar robots on legs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, randomize_joints, reading, rotations, settle, small_control, tolerance
from stepper.envs.task import Array, Reset, TaskView

_RUNNING_SPEED = 10.0
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
        return tolerance(
            reading(now, "torso_subtreelinvel")[:, 0], _RUNNING_SPEED, float("inf"), margin=_RUNNING_SPEED, fall="linear", value=0.0
        )

    def reset(self, reset: Reset) -> None:
        """Initial states: those in which the robot lies after 200 steps without controls from random angles of limited joints."""
        root = reset.qpos[:, :3].copy()
        randomize_joints(self.model(), reset.qpos, reset.rng)
        reset.qpos[:, :3] = root
        settle(reset, 200)


_HOPPER_HEIGHT = 0.6
"""Height of the torso above the foot at which the robot counts as standing, m."""
_HOPPING_SPEED = 2.0
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
        standing = tolerance(height, _HOPPER_HEIGHT, 2.0)
        if self.hopping:
            speed = reading(now, "torso_subtreelinvel")[:, 0]
            return standing * tolerance(speed, _HOPPING_SPEED, float("inf"), margin=_HOPPING_SPEED / 2.0, fall="linear", value=0.5)
        return standing * (small_control(now) + 4.0) / 5.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random torso angle."""
        randomize_joints(self.model(), reset.qpos, reset.rng)


_WALKER_HEIGHT = 1.2
"""Height of the torso at which the walker counts as standing, m."""


@dataclass(frozen=True, kw_only=True)
class Walker(SuiteTask):
    """Task: stand, or move to the right at a speed.

    Attributes:
        move_speed: Speed that earns the full reward of 1, m/s; 0 to stand.
    """

    file = "walker.xml"
    frame_skip: int = 10
    move_speed: float = 0.0

    def observations(self) -> tuple[Observation, ...]:
        """Cosines and sines of the bodies' angles, height of the torso, velocities: (24,)."""
        return (
            Observation("orientations", func=lambda now: rotations(now)[:, 1:, 0, ::2]),
            Observation("height", func=lambda now: now.xpos[:, 1, 2:], unit="m"),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: term for height and upright posture, times a term for the speed if `move_speed` is not 0."""
        standing = tolerance(now.xpos[:, 1, 2], _WALKER_HEIGHT, float("inf"), margin=_WALKER_HEIGHT / 2.0)
        stand: Array = (3.0 * standing + (1.0 + rotations(now)[:, 1, 2, 2]) / 2.0) / 4.0
        if self.move_speed == 0.0:
            return stand
        speed, wanted = reading(now, "torso_subtreelinvel")[:, 0], self.move_speed
        return stand * (5.0 * tolerance(speed, wanted, float("inf"), margin=wanted / 2.0, fall="linear", value=0.5) + 1.0) / 6.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random torso angle."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
