"""Gymnasium's InvertedPendulum-v5: a pole on a cart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms
from stepper.envs.tasks.base import NoisyTask


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

    def terminated(self, now: TaskView) -> Array:
        """Whether the pole is more than 0.2 rad from upright, (num_envs,) bool."""
        fallen: Array = ~(np.abs(now.qpos[:, 1]) <= 0.2)
        return fallen

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: 1 while the pole is upright."""
        survive = (~self.terminated(now)).astype(np.int64)
        return survive, {"reward_survive": survive}
