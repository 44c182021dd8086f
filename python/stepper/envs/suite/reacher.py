"""dm_control's reacher: a planar arm of two links, and a target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_joints, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.view import per_moment

_FINGER = 0.01
"""Radius of the finger, m."""


@dataclass(frozen=True, kw_only=True)
class Reacher(SuiteTask):
    """Task: bring the finger to the target.

    Attributes:
        target_size: Radius of the target, m.
    """

    file = "reacher.xml"
    frame_skip: int = 1
    target_size: float = 0.05

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, vector from the finger to the target, joint velocities: (6,)."""
        return (
            Observation("position", func=lambda now: now.qpos, unit="rad"),
            Observation("to_target", func=_to_target, unit="m"),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the finger in the target, else 0."""
        return tolerance(norm(_to_target(now)), 0.0, self.target_size + _FINGER)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits. The target is 0.05 to 0.2 m from the base of the arm."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
        angle, radius = reset.rng.uniform(0.0, 2.0 * np.pi, 1), reset.rng.uniform(0.05, 0.2, 1)
        place = np.hstack([radius * np.sin(angle), radius * np.cos(angle)])
        reset.sim.randomize({"geom_pos[target][0,1]": place}, envs=reset.envs)


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the finger to the target, m: (num_envs, 2)."""
    model = now.sim.model
    difference: Array = (now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, model.geom("finger").id])[:, :2]
    return difference
