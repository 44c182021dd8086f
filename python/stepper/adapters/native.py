"""Construction of the `StepperVectorEnv` that adapters of environments wrap."""

from __future__ import annotations

from typing import Any, TypeAlias

import gymnasium
from gymnasium.envs.registration import load_env_creator
from gymnasium.vector import AutoresetMode

from stepper.envs import StepperVectorEnv, Task
from stepper.envs.environment import autoreset
from stepper.shared.environments import import_env, unknown_id

Env: TypeAlias = str | Task | type[Task]
"""Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class."""


def with_autoreset(settings: dict[str, Any], mode: AutoresetMode, library: str) -> dict[str, Any]:
    """Copy of settings of environments, with the autoreset mode that a library needs.

    Args:
        settings: Arguments of `stepper.envs.StepperVectorEnv`.
        mode: The autoreset mode.
        library: Name of the library in the error message.

    Raises:
        ValueError: The settings have another mode.
    """
    given = autoreset(settings.get("autoreset_mode", mode))
    if given != mode:
        raise ValueError(f"autoreset_mode is {given.name}, must be {mode.name} for {library}: leave it out")
    return {**settings, "autoreset_mode": mode}


def make_native(env: Env, num_envs: int, **settings: Any) -> StepperVectorEnv:
    """Makes a vector environment from an id or a task.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`.

    Raises:
        TypeError: `env` is an environment of another simulator, or neither an id nor a task; or an argument is unknown.
        gymnasium.error.Error: `env` is an id that is not registered.
    """
    if not isinstance(env, str):
        return StepperVectorEnv(env, num_envs, **settings)
    name = import_env(env)
    try:
        entry: Any = gymnasium.spec(name).vector_entry_point
    except gymnasium.error.Error as error:
        raise type(error)(unknown_id(error, name, gymnasium.registry)) from error
    kind = load_env_creator(entry) if isinstance(entry, str) else entry
    if not (isinstance(kind, type) and issubclass(kind, StepperVectorEnv)):
        ours = f"stepper/{env.rpartition('/')[2]}"
        remedy = f"; did you mean {ours!r}?" if ours in gymnasium.registry else ""
        raise TypeError(f"{env!r} has the vector entry point {entry}, must have stepper.envs.StepperVectorEnv{remedy}")
    made = gymnasium.make_vec(name, num_envs=num_envs, vectorization_mode="vector_entry_point", **settings).unwrapped
    assert isinstance(made, StepperVectorEnv)
    return made
