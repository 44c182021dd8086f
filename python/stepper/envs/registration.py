"""The names under which Gymnasium finds the environments."""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

_EPISODES: dict[str, tuple[int, float | None]] = {
    "Ant": (1000, 6000.0),
    "HalfCheetah": (1000, 4800.0),
    "Hopper": (1000, 3800.0),
    "Humanoid": (1000, None),
    "HumanoidStandup": (1000, None),
    "InvertedDoublePendulum": (1000, 9100.0),
    "InvertedPendulum": (1000, 950.0),
    "Pusher": (100, 0.0),
    "Reacher": (50, -3.75),
    "Swimmer": (1000, 360.0),
    "Walker2d": (1000, None),
}
"""Actions of an episode, and the return from which on a task counts as solved, by task: those of Gymnasium's registry."""


def register_tasks() -> None:
    """Registers "stepper/NAME-v5" for every task, once."""
    for name, (steps, threshold) in _EPISODES.items():
        if f"stepper/{name}-v5" not in registry:
            register(
                f"stepper/{name}-v5",
                entry_point="stepper.envs.single:StepperEnv",
                vector_entry_point="stepper.envs.vector:StepperVectorEnv",
                max_episode_steps=steps,
                reward_threshold=threshold,
                kwargs={"task": name},
            )
