"""dm_control's ball on a string, which a cup catches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SLIDES, SuiteTask, randomize_without_overlap
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.streams import Rng

_HALF_WIDTH = 0.05
"""Half width and half height of the site "target" in the cup, m: a model has no sizes of sites."""


@dataclass(frozen=True, kw_only=True)
class BallInCup(SuiteTask):
    """Task: swing the ball on its string, a spatial tendon, into the cup."""

    file = "ball_in_cup.xml"
    frame_skip: int = 10

    def observations(self) -> tuple[Observation, ...]:
        """Positions and velocities of cup and ball, (8,)."""
        return SLIDES

    def score(self, now: TaskView) -> Array:
        """Score, (num_envs,): 1 with the ball in the cup, otherwise 0."""
        model = now.sim.model
        away = np.abs(now.site_xpos[:, model.site("target").id] - now.xpos[:, model.body("ball").id])
        inside = away[:, [0, 2]] < _HALF_WIDTH - model.geom("ball").size[0]
        return np.asarray(inside.all(axis=1), dtype=np.float64)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with the ball at a random position at which it touches nothing."""
        randomize_without_overlap(self.model(), reset.qpos, reset.rng, _place_ball)


def _place_ball(model: Model, qpos: Array, rng: Rng) -> None:
    """Draws positions of the ball into qpos, (n, nq), m."""
    for name, low, high in (("ball_x", -0.2, 0.2), ("ball_z", 0.2, 0.5)):
        at = model.joint(name).qposadr
        qpos[:, at : at + 1] = rng.uniform(low, high, 1)
