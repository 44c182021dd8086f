"""Checks of a task's hooks (`reset`, `advance` and others), which return nothing and change arrays in place."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import did_you_mean_or_all

Array = NDArray[Any]
IN_PLACE = {
    "reset": "write to arrays of reset, as in reset.qpos[:, :2] += reset.rng.uniform(-0.1, 0.1, 2)",
    "on_end": "write rows of envs, as in now.episode_state[name][envs] = ...",
    "advance": "step now.sim, and write to arrays of now.episode_state",
}
"""Remedies for error messages about hooks of a task that return a value: what the hook must change instead, by name of the hook."""

_SHAPES = (
    "rng.uniform(low, high, size) has the shape (n, size), a row for each environment that resets: for one number each, write "
    "rng.uniform(low, high, 1)[:, 0]"
)
"""Note on errors of NumPy in hooks that draw random numbers: the shape of the draws."""
NO_ASSIGNMENT = (
    "attributes of a task cannot be assigned: for data of episodes, define episode_state(self, num_envs), which returns an array for each "
    "name, and write to now.episode_state[name]"
)
"""Note on errors of a task that assigns to an attribute of the task."""


def call_hook(task: Any, hook: str, *arguments: Any) -> None:
    """Calls a hook of a task by name, and checks that it returns nothing.

    Raises:
        ValueError: The hook returns a value, which would be ignored.
    """
    try:
        result = getattr(task, hook)(*arguments)
    except ValueError as error:
        if "broadcast" in str(error) and hook == "reset" and _SHAPES not in getattr(error, "__notes__", ()):
            error.add_note(_SHAPES)
        raise
    except FrozenInstanceError as error:
        error.add_note(NO_ASSIGNMENT)
        raise
    if result is not None:
        raise ValueError(
            f"{type(task).__name__}.{hook} returns {in_words(result)}, must return nothing, because its result is ignored: {IN_PLACE[hook]}"
        )


def in_words(value: Any) -> str:
    """Description of a value in an error message: its type, with the shape of an array and the types in a tuple."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, tuple):
        return f"a tuple ({', '.join(type(part).__name__ for part in value)})"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if callable(value):
        return "a function"
    return f"a value of type {type(value).__name__}"


class EpisodeState(dict[str, Array]):
    """Dictionary of a task's per-episode arrays, (num_envs, ...) by name, with fixed names and shapes: those from `Task.episode_state`.

    Setting an unknown name raises KeyError, and setting another shape raises ValueError.

    Args:
        task: Name of the task's class, for error messages.
        values: Arrays by name.
    """

    def __init__(self, task: str, values: Mapping[str, Array]):
        super().__init__(values)
        self._task = task

    def __missing__(self, name: str) -> Array:
        raise KeyError(self._unknown(name))

    def __setitem__(self, name: str, value: Any) -> None:
        if name not in self:
            raise KeyError(self._unknown(name))
        if np.shape(value) != self[name].shape:
            raise ValueError(
                f"episode_state[{name!r}] of {self._task} is set to {in_words(value)}, must have the shape {self[name].shape}: set rows in "
                f"place, as episode_state[{name!r}][envs] = ..."
            )
        super().__setitem__(name, np.asarray(value))

    def _unknown(self, name: str) -> str:
        own = f"; define episode_state(self, num_envs), which returns {{{name!r}: np.zeros(num_envs)}}"
        hint = did_you_mean_or_all(name, self) if self else own
        return f"{self._task}.episode_state returns no {name!r}{hint}"

    def __reduce__(self) -> Any:
        return EpisodeState, (self._task, dict(self))


def episode_state_of(task: Any, num_envs: int, carried: Collection[str]) -> EpisodeState:
    """Initial per-episode arrays of a task, from its method `episode_state`.

    Raises:
        ValueError: The method returns no mapping, or an array without num_envs rows, or a name in `carried` is not among the arrays.
    """
    kind, values = type(task).__name__, task.episode_state(num_envs)
    if not isinstance(values, Mapping):
        raise ValueError(
            f"{kind}.episode_state returns {in_words(values)}, must return a dictionary of arrays (num_envs, ...) by name, which may be "
            'empty, as {"target": np.zeros((num_envs, 3))}'
        )
    for name, value in values.items():
        if np.shape(value)[:1] != (num_envs,):
            raise ValueError(
                f"{kind}.episode_state returns {name!r} of shape {np.shape(value)}, must be ({num_envs}, ...): one row for each environment"
            )
    if unknown := sorted(set(carried) - set(values)):
        raise ValueError(
            f"{kind}.carried names {unknown}, which episode_state does not return: return them there, as it returns "
            f"{', '.join(values) or 'nothing'}"
        )
    return EpisodeState(kind, {name: np.asarray(value) for name, value in values.items()})
