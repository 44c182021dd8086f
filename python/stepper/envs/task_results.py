"""Calls of a task's methods with checks of the results. An error names the task, the method, what it returned, and what it must return."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stepper._arrays import array_of
from stepper._hints import WrongArgumentError
from stepper._stepper import Model
from stepper.envs.observations import Group, Observation
from stepper.envs.task import Array, Task, TaskView, Terms
from stepper.shared.arguments import check_mapping, check_takes, in_words


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


_METHODS = {
    name: list(inspect.signature(method).parameters)[1:]
    for name, method in vars(Task).items()
    if inspect.isfunction(method) and name[0] != "_"
}
"""Names of the arguments of each method of a task, without `self`."""
Table = list[tuple[Observation, slice]]
"""Type of the list of a task's observed quantities (`Observation`), each with the slice of its columns in the observation array."""
POLICY = "policy"
"""Name of the observation group for the policy."""


def wrong_result(task: Any, method: str, result: Any, wanted: str) -> ValueError:
    """Error for a wrong result of a task's method; `wanted` describes a right one."""
    return ValueError(f"{type(task).__name__}.{method} returns {in_words(result)}, must return {wanted}")


def call_hook(task: Any, hook: str, *arguments: Any) -> None:
    """Calls a hook of a task by name, and checks that it returns nothing."""
    result = getattr(task, hook)(*arguments)
    if result is not None:
        raise wrong_result(task, hook, result, "nothing: write to arrays of its argument in place, or to rows of episode_state")


def check_methods(task: Task) -> None:
    """Raises TypeError if a member of a task does not fit the member of `Task` that it overrides.

    A method must take the same number of arguments.
    """
    kind = type(task).__name__
    check_mapping(
        f"{kind}.camera", task.camera, '{"distance": 3.0}; the argument camera_name of the environment names a camera of the file'
    )
    if type(task).reward is Task.reward and type(task).rewards is Task.rewards:
        raise WrongArgumentError(f"{kind} has no reward: define reward(self, now), or rewards(self), which returns terms by name")
    if isinstance(task.carried, str):
        raise WrongArgumentError(f"{kind}.carried is {task.carried!r}, must be a tuple of names: ({task.carried!r},)")
    for name, arguments in _METHODS.items():
        member = getattr(task, name)
        if not callable(member):
            raise WrongArgumentError(
                f"{kind}.{name} is {in_words(member)}, must be a method: write def {name}({', '.join(['self', *arguments])})"
            )
        check_takes(member, arguments, f"{kind}.{name}", is_method=True)


def model_of(task: Task) -> Model:
    """Model of a task; a ValueError if `task.model` returns anything but a `stepper.Model`."""
    found: Any = task.model()
    if not isinstance(found, Model):
        raise wrong_result(task, "model", found, "a stepper.Model: return stepper.load(...)")
    return found


def bounds_of(task: Task, model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of a task's actions, (n,) each; a ValueError if `task.action_bounds` returns anything else."""
    found: Any = task.action_bounds(model)
    if isinstance(found, tuple | list | np.ndarray) and len(found) == 2:
        low, high = (array_of(f"a bound of {type(task).__name__}.action_bounds", bound) for bound in found)
        if low.ndim == 1 and low.shape == high.shape and not np.any(low > high):
            return low, high
    raise wrong_result(task, "action_bounds", found, "two arrays (n,), lower and upper bounds: -np.ones(model.nu), np.ones(model.nu)")


def tables_of(task: Task, now: TaskView) -> dict[str, Table]:
    """Tables of the observed quantities of a task by name of the observation group; "policy" for a task without groups.

    Raises:
        ValueError: `task.observations` does not return one or more `Observation`, or the value of a row is no array (num_envs, ...).
        AttributeError: A row without a function names no quantity of the stepper.
    """
    given: Any = task.observations()
    if not isinstance(given, Mapping):
        return {POLICY: _table_of(task, given, now)}
    if POLICY not in given:
        known = ", ".join(map(repr, given)) or "none"
        raise ValueError(f"{type(task).__name__}.observations returns the groups {known}, must have the group {POLICY!r}")
    groups = {name: rows.table() if isinstance(rows, Group) else rows for name, rows in given.items()}
    return {str(name): _table_of(task, rows, now) for name, rows in groups.items()}


def _table_of(task: Task, given: Any, now: TaskView) -> Table:
    """Rows of a table of observations, each with the slice of its columns in the observation."""
    given = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else given
    if not isinstance(given, list) or not given or not all(isinstance(row, Observation) for row in given):
        wrong = next((row for row in given if not isinstance(row, Observation)), given) if isinstance(given, list) else given
        raise wrong_result(task, "observations", wrong, 'a tuple of Observation, as (Observation("qpos"), Observation("qvel"))')
    rows: Table = []
    for row in given:
        if any(row.name == other.name for other, _ in rows):
            raise ValueError(
                f"{type(task).__name__}.observations returns two rows with the name {row.name!r}: give one another name, as "
                "Observation('name', func=...)"
            )
        at = rows[-1][1].stop if rows else 0
        resolved = replace(row, func=row.func or row._function(task))
        rows.append((resolved, slice(at, at + row.history * _width(task, resolved, now))))
    return rows


def _width(task: Task, row: Observation, now: TaskView) -> int:
    """Number of columns that a row of the observation table has in the observation."""
    where, value = f"{type(task).__name__}.observations: the row {row.name!r}", row.quantity(now)
    if not isinstance(value, np.ndarray) or value.shape[:1] != (now.num_envs,):
        raise ValueError(f"{where} is {in_words(value)}, must be an array ({now.num_envs}, ...): one row for each environment")
    try:
        shape = row.read(now).shape
    except IndexError as error:
        raise ValueError(f"{where}: columns is {row.columns!r}: {error}") from error
    if len(shape) != 2:
        raise ValueError(f"{where}: columns is {row.columns!r}, must be a slice, as slice(0, 3), or a list")
    return int(shape[1])


def rewards_of(task: Task, now: TaskView, num_envs: int) -> tuple[Array, Terms]:
    """Rewards (num_envs,) and entries for the info dict from `Task.reward`, after a check."""
    result: Any = task.reward(now)
    reward, terms = result if isinstance(result, tuple) and len(result) == 2 else (result, {})
    if type(terms) is not dict and not isinstance(terms, Mapping):
        raise wrong_result(task, "reward", result, f"rewards ({num_envs},), or two values: rewards, and a dictionary for the info dict")
    return rows_of(task, "reward", reward, np.float64, num_envs), _checked(task, "reward", terms, num_envs) if terms else {}


def position_of(task: Task, now: TaskView, num_envs: int) -> Array | None:
    """Result of `Task.position`, (num_envs, ...) in its unit, or None; a ValueError if it is anything else."""
    found: Any = task.position(now)
    if found is not None and not (isinstance(found, np.ndarray) and found.shape[:1] == (num_envs,)):
        raise wrong_result(task, "position", found, f"an array ({num_envs}, ...), one row for each environment, or None")
    return found


def infos_of(task: Task, now: TaskView, num_envs: int) -> Terms:
    """Entries for the info dict from `Task.info`; a ValueError if it does not return arrays (num_envs, ...) by name."""
    infos: Any = task.info(now)
    if type(infos) is not dict and not isinstance(infos, Mapping):
        raise wrong_result(task, "info", infos, f"a dictionary of arrays ({num_envs}, ...) by name")
    return _checked(task, "info", infos, num_envs) if infos else {}


def _checked(task: Task, method: str, terms: Mapping[str, Any], num_envs: int) -> Terms:
    """Entries for the info dict, returned by the task's method `method`; a ValueError if one is not an array (num_envs, ...)."""
    for name, value in terms.items():
        if not isinstance(value, np.ndarray) or value.shape[:1] != (num_envs,):
            raise ValueError(
                f"{type(task).__name__}.{method} returns {name!r} as {in_words(value)}, must be an array ({num_envs}, ...): one row for "
                "each environment; np.full(now.num_envs, value) makes one of a number"
            )
    return dict(terms)


def rows_of(task: Task, method: str, values: Any, dtype: Any, num_envs: int) -> Array:
    """Converts a result of the task's method `method` to a new array (num_envs,) of type `dtype`, float64 or bool."""
    try:
        array = np.array(values, dtype=None if dtype is bool else dtype)
        if array.shape == (num_envs,) and (dtype is not bool or array.dtype.kind == "b"):
            return array
        values = array if array.shape != (num_envs,) else array.dtype
    except ValueError:  # Rows of different lengths, such as a tuple of an array and a dictionary.
        pass
    raise wrong_result(task, method, values, f"an array ({num_envs},) of {np.dtype(dtype)}: one value for each environment")
