"""dm_control's reacher: a planar arm of two links, and a target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Stepper
from stepper.envs.suite.base import SuiteTask, move_geom, norm, randomize_joints, tolerance
from stepper.envs.task import Array, Moment, Observation, Terms, per_moment
from stepper.shared.streams import Rng

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

    def score(self, now: Moment) -> Array:
        """Score: 1 with the finger in the target, else 0."""
        return tolerance(norm(_to_target(now)), 0.0, self.target_size + _FINGER)

    def sample_state(self, qpos: Array, qvel: Array, rng: Rng) -> None:
        """Initial states: at rest, with random angles within their limits."""
        randomize_joints(self.model(), qpos, rng)

    def on_reset(self, sim: Stepper, episode_state: Terms, mask: Array, rng: Rng) -> None:
        """Moves the target to a random place, 0.05 to 0.2 m from the base of the arm."""
        angle, radius = rng.uniform(0.0, 2.0 * np.pi, 1), rng.uniform(0.05, 0.2, 1)
        move_geom(sim, mask, "target", np.hstack([radius * np.sin(angle), radius * np.cos(angle)]), slice(0, 2))


@per_moment
def _to_target(now: Moment) -> Array:
    """Vector from the finger to the target, m: (num_envs, 2)."""
    model = now.sim.model
    difference: Array = (now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, model.geom("finger").id])[:, :2]
    return difference
