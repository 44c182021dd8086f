"""Registration of the environments with Gymnasium."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

from stepper.envs.basic import FallingBlock, Grasp, falling_block, grasp
from stepper.envs.locomotion import G1Rough, G1Velocity, Go1Rough, Go1Velocity
from stepper.envs.myosuite import MYOSUITE
from stepper.envs.suite import SUITE

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
"""Number of actions per episode, and return at which the task counts as solved, by name of the task, as in Gymnasium's registry.

None means that the registry has no such return.
"""


def register_tasks() -> None:
    """Registers all environments with Gymnasium, unless they are registered already.

    Names are "stepper/NAME-v5" for Gymnasium's tasks, "stepper/dm_control.NAME-v0" and "stepper/myosuite.NAME-v0" for those of dm_control
    and MyoSuite, and "stepper/NAME-v0" for the others. (These names have a dot, because Gymnasium allows only one slash.)
    """
    for name, (steps, threshold) in _EPISODES.items():
        _register(f"stepper/{name}-v5", steps, {"task": name}, threshold)
    _register("stepper/FallingBlock-v0", falling_block.STEPS, {"task": FallingBlock, "options": falling_block.OPTIONS})
    _register("stepper/Grasp-v0", grasp.STEPS, {"task": Grasp, "options": grasp.OPTIONS})
    for name, robot in (("G1Velocity", G1Velocity), ("Go1Velocity", Go1Velocity)):
        _register(f"stepper/{name}-v0", 1000, {"task": robot})
        _register(f"stepper/{name}Real-v0", 1000, {"task": robot, "noise": 1.0, "motors": True})
    for name, rough in (("G1Rough", G1Rough), ("Go1Rough", Go1Rough)):
        _register(f"stepper/{name}-v0", 1000, {"task": rough})
    for name, (kind, arguments) in SUITE.items():
        _register(f"stepper/dm_control.{name}-v0", kind.episode_steps, {"task": kind, **arguments})
    for name, (pose, arguments) in MYOSUITE.items():
        _register(f"stepper/myosuite.{name}-v0", pose.episode_steps, {"task": pose, **arguments})


def _register(name: str, steps: int | None, arguments: dict[str, Any], threshold: float | None = None) -> None:
    """Registers an environment with Gymnasium, unless the name is registered already."""
    if name not in registry:
        register(
            name,
            entry_point="stepper.envs.single:StepperEnv",
            vector_entry_point="stepper.envs.vector:StepperVectorEnv",
            max_episode_steps=steps,
            reward_threshold=threshold,
            kwargs=arguments,
        )
