"""dm_control's acrobot: two links, with an actuator on the second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, rotations, tolerance
from stepper.envs.task import Array, Reset, TaskView

_TARGET = 0.2
"""Radius of the target, m."""


@dataclass(frozen=True, kw_only=True)
class Acrobot(SuiteTask):
    """Task: swing the tip of a two-link arm up to a target, and hold it there.

    Attributes:
        sparse: Whether the reward is sparse: 1 in the target, 0 elsewhere.
    """

    file = "acrobot.xml"
    frame_skip: int = 1
    sparse: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Sines and cosines of the angles of both links from the vertical, and joint velocities: (6,)."""
        return (
            Observation("horizontal", func=lambda now: rotations(now)[:, 1:, 0, 2]),
            Observation("vertical", func=lambda now: rotations(now)[:, 1:, 2, 2]),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the tip in the target. Outside, the score decreases with the distance; with `sparse` it is 0."""
        target, tip = (now.site_xpos[:, now.sim.model.site(name).id] for name in ("target", "tip"))
        return tolerance(norm(target - tip), 0.0, _TARGET, margin=0.0 if self.sparse else 1.0)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with uniform random angles."""
        reset.qpos[:] = reset.rng.uniform(-np.pi, np.pi, 2)
