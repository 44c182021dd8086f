"""Data of episodes that a task stores outside of the stepper (`Task.episode_state`)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.shared.functions import in_words

Array = NDArray[Any]


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
        return (
            f"{self._task}.episode_state returns no {name!r}, it returns {', '.join(self) or 'nothing'}: define an array of this name there"
        )

    def __reduce__(self) -> Any:
        return EpisodeState, (self._task, dict(self))


def episode_state_of(task: Any, num_envs: int, carried: Collection[str]) -> EpisodeState:
    """Initial per-episode arrays of a task, from its method `episode_state`."""
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
