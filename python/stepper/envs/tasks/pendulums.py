"""Gymnasium's InvertedPendulum-v5 and InvertedDoublePendulum-v5: poles on a cart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms
from stepper.envs.tasks.base import NoisyTask
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class InvertedPendulum(NoisyTask):
    """Task: keep the pole within 0.2 rad of upright. The arguments are those of Gymnasium's environment."""

    camera: ClassVar[Camera] = {"distance": 2.04}

    xml_file: str = "inverted_pendulum.xml"
    frame_skip: int = 2
    reset_noise_scale: float = 0.01

    def observations(self) -> tuple[Observation, ...]:
        """Positions and velocities: (4,)."""
        return Observation("qpos"), Observation("qvel")

    @per_moment
    def terminated(self, now: TaskView) -> Array:
        """Whether the pole is more than 0.2 rad from upright, (num_envs,) bool."""
        fallen: Array = ~(np.abs(now.qpos[:, 1]) <= 0.2)
        return fallen

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: 1 while the pole is upright."""
        survive = (~self.terminated(now)).astype(np.int64)
        return survive, {"reward_survive": survive}


WITHIN = (-10.0, 10.0)
"""Bounds to which the observation clips velocities (m/s, rad/s) and the constraint force (N)."""


@dataclass(frozen=True, kw_only=True)
class InvertedDoublePendulum(NoisyTask):
    """Task: keep the tip of the second pole above 1 m. The arguments are those of Gymnasium's environment.

    The reward uses the position of the tip in the state after the step. Gymnasium uses the position in the last stage of MuJoCo's
    Runge-Kutta step, which differs by O(h^3) for the time step h. With contact="hard", the margin of the cart's joint limits narrows the
    cart's range by 0.01 m at each end.
    """

    camera: ClassVar[Camera] = {"distance": 4.1225, "lookat": (0.0, 0.0, 0.1225)}
    normal_velocities: ClassVar[bool] = True

    xml_file: str = "inverted_double_pendulum.xml"
    frame_skip: int = 5
    healthy_reward: float = 10.0
    reset_noise_scale: float = 0.1

    def observations(self) -> tuple[Observation, ...]:
        """Position of the cart, sines and cosines of the angles, velocities, and the clipped constraint force on the cart: (9,)."""
        return (
            Observation("qpos", columns=slice(0, 1)),
            Observation("sin", func=lambda now: np.sin(now.qpos[:, 1:])),
            Observation("cos", func=lambda now: np.cos(now.qpos[:, 1:])),
            Observation("qvel", clip=WITHIN),
            Observation("qfrc_constraint", columns=slice(0, 1), clip=WITHIN),
        )

    @per_moment
    def terminated(self, now: TaskView) -> Array:
        """Whether the tip is at most 1 m high, (num_envs,)."""
        low: Array = ~(now.site_xpos[:, 0, 2] > 1.0)
        return low

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: a bonus while the tip is above 1 m, minus weighted squares of its offset from (0, 2) m and of the hinge velocities."""
        x, _, z = now.site_xpos[:, 0].T
        survive = self.healthy_reward * ~self.terminated(now)
        distance = 0.01 * x**2 + (z - 2.0) ** 2
        velocity = 1e-3 * now.qvel[:, 1] ** 2 + 5e-3 * now.qvel[:, 2] ** 2
        terms = {"reward_survive": survive, "distance_penalty": -distance, "velocity_penalty": -velocity}
        return survive - distance - velocity, terms
