"""Gymnasium's Reacher-v5: a planar arm of two links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, MujocoTask, Reset, TaskView, Terms, square_sum
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Reacher(MujocoTask):
    """Task: bring the fingertip to the target. The arguments are those of Gymnasium's environment. An episode never terminates.

    Observations and rewards use the position of the fingertip in the state after the step. Gymnasium uses the position in the last stage
    of MuJoCo's Runge-Kutta step, which differs by O(h^3) for the time step h.
    """

    camera: ClassVar[Camera] = {"distance": 1.24}
    xml_file: str = "reacher.xml"
    frame_skip: int = 2
    reward_dist_weight: float = 1.0
    reward_control_weight: float = 1.0

    def observations(self) -> tuple[Observation, ...]:
        """Cosines and sines of the angles, position of the target, angular velocities, and fingertip minus target in x and y: (10,)."""
        return (
            Observation("cos", func=lambda now: np.cos(now.qpos[:, :2])),
            Observation("sin", func=lambda now: np.sin(now.qpos[:, :2])),
            Observation("qpos", columns=slice(2, None)),
            Observation("qvel", columns=slice(0, 2)),
            Observation("fingertip", func=_to_target, columns=slice(0, 2), unit="m"),
        )

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: minus the distance from the fingertip to the target, minus a cost of squared controls."""
        distance = -self.reward_dist_weight * np.sqrt(square_sum(_to_target(now)))
        control = -self.reward_control_weight * square_sum(now.action)
        return distance + control, {"reward_dist": distance, "reward_ctrl": control}

    def reset(self, reset: Reset) -> None:
        """Initial states: the arm in the reference pose with uniform noise on angles and velocities, the target at rest at a random place.

        The place is uniformly distributed in the disc of radius 0.2 m about the origin.
        """
        reset.qpos += reset.rng.uniform(-0.1, 0.1, reset.qpos.shape[1])
        radius, angle = 0.2 * np.sqrt(reset.rng.uniform(0.0, 1.0, 1)[:, 0]), reset.rng.uniform(-np.pi, np.pi, 1)[:, 0]
        reset.qpos[:, -2:] = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        reset.qvel += reset.rng.uniform(-0.005, 0.005, reset.qvel.shape[1])
        reset.qvel[:, -2:] = 0.0


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the target to the fingertip, (num_envs, 3), m."""
    names = now.sim.model.body_names
    difference: Array = now.xpos[:, names.index("fingertip")] - now.xpos[:, names.index("target")]
    return difference
