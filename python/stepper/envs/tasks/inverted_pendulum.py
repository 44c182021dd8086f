"""Gymnasium's InvertedPendulum-v5: a pole on a cart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array, Camera, Moment, MujocoTask, Observation, Terms
from stepper.shared.streams import Rng


@dataclass(frozen=True, kw_only=True)
class InvertedPendulum(MujocoTask):
    """Task: keep the pole within 0.2 rad of upright. The arguments are those of Gymnasium's environment."""

    camera: ClassVar[Camera] = {"distance": 2.04}

    xml_file: str = "inverted_pendulum.xml"
    frame_skip: int = 2
    reset_noise_scale: float = 0.01

    def observations(self) -> tuple[Observation, ...]:
        """Positions and velocities: (4,)."""
        return Observation("qpos"), Observation("qvel")

    def healthy(self, now: Moment) -> Array:
        """Whether the pole is within 0.2 rad of upright, (num_envs,) bool."""
        upright: Array = np.abs(now.qpos[:, 1]) <= 0.2
        return upright

    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """Reward: 1 while the pole is upright."""
        survive = now.healthy.astype(np.int64)
        return survive, {"reward_survive": survive}

    def sample_state(self, qpos: Array, qvel: Array, rng: Rng) -> None:
        """Initial states: the reference pose with uniform noise on positions and velocities."""
        scale = self.reset_noise_scale
        qpos += rng.uniform(-scale, scale, qpos.shape[1])
        qvel += rng.uniform(-scale, scale, qvel.shape[1])
