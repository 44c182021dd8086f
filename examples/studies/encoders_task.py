"""Training of the policy of encoders_trained.py: the task InvertedDoublePendulum-v5, observed through noisy encoders.

    python examples/studies/encoders_task.py stepper/Encoders-v0 --steps 6000000 --threads 1

The options are those of `stepper train`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import encoders  # type: ignore[import-not-found]  # noqa: E402
import gymnasium  # noqa: E402
import stepper  # noqa: E402
from stepper.envs.observations import Observation  # noqa: E402
from stepper.envs.tasks.pendulums import InvertedDoublePendulum  # noqa: E402


@dataclass(frozen=True, kw_only=True)
class Encoders(InvertedDoublePendulum):
    """Task of keeping the tip above 1 m, observed through encoders with noise, drift and delay."""

    def model(self) -> Any:
        """Model of the scene with its sensors."""
        return stepper.load(encoders.model(), strict=False)

    def sensors(self) -> Any:
        """Sensor model of the training: encoders with noise, drift and delay, as in encoders.py."""
        return encoders.encoders()

    def observations(self) -> Any:
        """Observation of the policy, (9,)."""
        return (Observation("encoders", func=lambda now: encoders.seen(now.sensordata)),)


def register() -> None:
    """Register the task as stepper/Encoders-v0."""
    gymnasium.register(
        "stepper/Encoders-v0",
        entry_point="stepper.envs.single:StepperEnv",
        vector_entry_point="stepper.envs.vector:StepperVectorEnv",
        max_episode_steps=1000,
        kwargs={"task": Encoders},
    )


if __name__ == "__main__":
    from stepper.policies import ppo

    # The module name must not be __main__, so that checkpoints can be unpickled elsewhere.
    sys.modules["encoders_task"] = sys.modules["__main__"]
    Encoders.__module__ = "encoders_task"
    register()
    ppo.main()
