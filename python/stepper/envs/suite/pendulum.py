"""dm_control's pendulum with a weak motor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, rotation, tolerance
from stepper.envs.task import Array, Reset, TaskView

_UPRIGHT = float(np.cos(np.deg2rad(8.0)))
"""Cosine of the largest rewarded angle from upright."""


@dataclass(frozen=True, kw_only=True)
class Pendulum(SuiteTask):
    """Task: swing the pendulum up with little torque, and hold it there."""

    file = "pendulum.xml"
    frame_skip: int = 1

    def observations(self) -> tuple[Observation, ...]:
        """Cosine, sine and velocity of the angle: (3,)."""
        return (
            Observation("orientation", func=lambda now: rotation(now, "pole")[:, [2, 0], 2]),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 within 8 degrees of upright, else 0."""
        return tolerance(rotation(now, "pole")[:, 2, 2], _UPRIGHT, 1.0)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with a uniform random angle."""
        reset.qpos[:] = reset.rng.uniform(-np.pi, np.pi, 1)
