"""Calls of a task's methods with checks of the results. An error names the task, the method, what it returned, and the remedy."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np

from stepper._arrays import array_of
from stepper._hints import WrongArgumentError
from stepper._stepper import Model
from stepper.envs.observations import Group, Observation
from stepper.envs.task import Array, Task, TaskView, Terms
from stepper.shared.arguments import check_mapping
from stepper.shared.functions import check_takes, in_words

_METHODS = {
    name: list(inspect.signature(method).parameters)[1:]
    for name, method in vars(Task).items()
    if inspect.isfunction(method) and name[0] != "_"
}
"""Names of the arguments of each method of a task, without `self`."""
Table = list[tuple[Observation, slice]]
"""Type of the list of a task's observed quantities (`Observation`), each with the slice of its columns in the observation array."""
_IN_PLACE = {
    "reset": "write to arrays of reset, as in reset.qpos[:, :2] += reset.rng.uniform(-0.1, 0.1, 2)",
    "on_end": "write rows of envs, as in now.episode_state[name][envs] = ...",
    "advance": "step now.sim, and write to arrays of now.episode_state",
}
"""Remedies for error messages about hooks of a task that return a value, by name of the hook: changes in place."""
_SHAPES = (
    "rng.uniform(low, high, size) has the shape (n, size), a row for each environment that resets: for one number each, write "
    "rng.uniform(low, high, 1)[:, 0]"
)
"""Note on errors of NumPy in hooks that draw random numbers: the shape of the draws."""
_NO_ASSIGNMENT = (
    "attributes of a task cannot be assigned: for data of episodes, define episode_state(self, num_envs), which returns an array for each "
    "name, and write to now.episode_state[name]"
)
"""Note on errors of a task that assigns to an attribute of the task."""
POLICY = "policy"
"""Name of the observation group for the policy."""


def call_hook(task: Any, hook: str, *arguments: Any) -> None:
    """Calls a hook of a task by name, and checks that it returns nothing."""
    try:
        result = getattr(task, hook)(*arguments)
    except ValueError as error:
        if "broadcast" in str(error) and hook == "reset" and _SHAPES not in getattr(error, "__notes__", ()):
            error.add_note(_SHAPES)
        raise
    except FrozenInstanceError as error:
        error.add_note(_NO_ASSIGNMENT)
        raise
    if result is not None:
        raise ValueError(
            f"{type(task).__name__}.{hook} returns {in_words(result)}, must return nothing, its result is ignored: {_IN_PLACE[hook]}"
        )


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
    """Model of a task; a TypeError if `task.model` returns anything but a `stepper.Model`."""
    found: Any = task.model()
    if not isinstance(found, Model):
        raise WrongArgumentError(
            f"{type(task).__name__}.model returns {in_words(found)}, must return a stepper.Model: return stepper.load(...)"
        )
    return found


def bounds_of(task: Task, model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of a task's actions, (n,) each; a ValueError if `task.action_bounds` returns anything else."""
    found: Any = task.action_bounds(model)
    if isinstance(found, tuple | list | np.ndarray) and len(found) == 2:
        low, high = (array_of(f"a bound of {type(task).__name__}.action_bounds", bound) for bound in found)
        if low.ndim == 1 and low.shape == high.shape and not np.any(low > high):
            return low, high
        found = (low, high)
    raise ValueError(
        f"{type(task).__name__}.action_bounds returns {_pair_in_words(found)}, must return two arrays (n,), lower and upper bounds: "
        "return np.full(model.nu, -1.0), np.full(model.nu, 1.0)"
    )


def _pair_in_words(found: Any) -> str:
    """Description, for an error message, of what `Task.action_bounds` returned instead of lower and upper bounds."""
    if not (isinstance(found, tuple) and len(found) == 2 and all(isinstance(bound, np.ndarray) for bound in found)):
        return in_words(found)
    low, high = found
    if low.ndim == 1 and low.shape == high.shape:
        return f"a lower bound {low[low > high][0]} above the upper bound {high[low > high][0]}"
    return f"arrays of shapes {low.shape} and {high.shape}"


def tables_of(task: Task, now: TaskView) -> dict[str, Table]:
    """Tables of the observed quantities of a task by name of the observation group; "policy" for a task without groups.

    Raises:
        ValueError: `task.observations` does not return one or more `Observation`, or the value of a row is no array (num_envs, ...).
        AttributeError: A row without a function names no quantity of the stepper.
    """
    given: Any = task.observations()
    kind = type(task).__name__
    if isinstance(given, Group):
        raise ValueError(f'{kind}.observations returns a Group, must return groups by name: return {{"policy": Group(...)}}')
    if not isinstance(given, Mapping) or any(isinstance(rows, Observation) or callable(rows) for rows in given.values()):
        return {POLICY: _table_of(kind, given, now)}
    if POLICY not in given:
        known = ", ".join(map(repr, given)) or "none"
        raise ValueError(f'{kind}.observations returns the groups {known}, must have a group "policy", which environments return')
    groups = {name: rows.table() if isinstance(rows, Group) else rows for name, rows in given.items()}
    return {str(name): _table_of(kind, rows, now) for name, rows in groups.items()}


def _table_of(kind: str, given: Any, now: TaskView) -> Table:
    """Rows of a table of observations, each with the slice of its columns in the observation."""
    if isinstance(given, Observation):
        raise ValueError(f"{kind}.observations returns a single Observation, must return a tuple of them: return (Observation(...),)")
    if isinstance(given, str | Mapping | np.ndarray) or not isinstance(given, Iterable):
        raise ValueError(
            f"{kind}.observations returns {in_words(given)}, must return a tuple of stepper.envs.Observation: "
            'return (Observation("qpos"), Observation("speed", func=lambda now: now.qvel[:, :1])), where func is a function of now'
        )
    rows: Table = []
    for row in given:
        if not isinstance(row, Observation):
            raise ValueError(
                f"{kind}.observations returns {in_words(row)} as row {len(rows)}, must be a stepper.envs.Observation: return "
                "Observation(name), or Observation(name, func=...) with a function of now"
            )
        if any(row.name == other.name for other, _ in rows):
            raise ValueError(
                f"{kind}.observations returns two rows with the name {row.name!r}: give one another name, as Observation('name', func=...)"
            )
        at = rows[-1][1].stop if rows else 0
        rows.append((row, slice(at, at + row.history * _width(kind, row, now))))
    if not rows:
        raise ValueError(f'{kind}.observations returns no rows: return at least one, as (Observation("qpos"), Observation("qvel"))')
    return rows


def _width(kind: str, row: Observation, now: TaskView) -> int:
    """Number of columns that a row of the observation table has in the observation."""
    expected = len(now.qpos)
    if row.func is None:
        try:
            is_quantity = row.name.isidentifier() and hasattr(type(now), row.name) and row.name not in now.task.commands
            value = getattr(now, row.name) if is_quantity else row.read(now)
        except AttributeError as error:
            raise AttributeError(
                f"{kind}.observations has the row {row.name!r} without func, so that it must be a quantity of the stepper: {error}. For an "
                f"element of the model, write Observation({row.name!r}, func=lambda now: now.read('xpos', {row.name!r}))"
            ) from error
        if callable(value) or not isinstance(value, np.ndarray):
            raise ValueError(
                f"{kind}.observations has the row {row.name!r} without func, which is {in_words(value)} and no array (num_envs, ...): give "
                f"Observation({row.name!r}, func=...)"
            )
    else:
        value = row.func(now)
    if not isinstance(value, np.ndarray) or value.shape[:1] != (expected,):
        raise ValueError(
            f"{kind}.observations: the function of the row {row.name!r} returns {in_words(value)}, must return an array ({expected}, ...): "
            "one row for each environment"
        )
    try:
        width = row.read(now).shape
    except IndexError as error:
        raise ValueError(f"{kind}.observations: columns of the row {row.name!r} is {row.columns!r}: {error}") from error
    if len(width) != 2:
        raise ValueError(
            f"{kind}.observations: columns of the row {row.name!r} is {row.columns!r}, must be a slice, as slice(0, 3), or a list"
        )
    return int(width[1])


def rewards_of(task: Task, now: TaskView, num_envs: int) -> tuple[Array, Terms]:
    """Rewards (num_envs,) and entries for the info dict from `Task.reward`, after a check."""
    try:
        result: Any = task.reward(now)
    except FrozenInstanceError as error:
        error.add_note(_NO_ASSIGNMENT)
        raise
    if not isinstance(result, tuple):
        return rows_of(task, "reward", result, np.float64, num_envs), {}
    if not (len(result) == 2 and isinstance(result[1], Mapping)):
        raise ValueError(
            f"{type(task).__name__}.reward returns {in_words(result)}, must return rewards (num_envs,), or two values: rewards, and a "
            'dictionary of entries for the info dict, as (rewards, {"height": now.qpos[:, 2]})'
        )
    terms = dict(result[1])
    check_terms(task, "reward", terms, num_envs)
    return rows_of(task, "reward", result[0], np.float64, num_envs), terms


def position_of(task: Task, now: TaskView, num_envs: int) -> Array | None:
    """Result of `Task.position`, (num_envs, ...) in its unit, or None; a ValueError if it is anything else."""
    found: Any = task.position(now)
    if found is not None and not (isinstance(found, np.ndarray) and found.shape[:1] == (num_envs,)):
        raise ValueError(
            f"{type(task).__name__}.position returns {in_words(found)}, must be an array ({num_envs}, ...): one row for each environment, "
            "or None"
        )
    return found


def infos_of(task: Task, now: TaskView, num_envs: int) -> Terms:
    """Entries for the info dict from `Task.info`; a ValueError if it does not return arrays (num_envs, ...) by name."""
    infos: Any = task.info(now)
    if not isinstance(infos, Mapping):
        raise ValueError(
            f"{type(task).__name__}.info returns {in_words(infos)}, must return a dictionary of arrays (num_envs, ...) by name, "
            "which may be empty"
        )
    check_terms(task, "info", infos, num_envs)
    return dict(infos)


def check_terms(task: Task, method: str, terms: Mapping[str, Any], num_envs: int) -> None:
    """Raises ValueError if an entry for the info dict, returned by the task's method `method`, is not an array (num_envs, ...)."""
    for name, value in terms.items():
        if not isinstance(value, np.ndarray) or value.shape[:1] != (num_envs,):
            raise ValueError(
                f"{type(task).__name__}.{method} returns {name!r} as {in_words(value)}, must be an array ({num_envs}, ...): one row for "
                "each environment; np.full(now.sim.num_envs, value) makes one of a number"
            )


def rows_of(task: Task, method: str, values: Any, dtype: Any, num_envs: int) -> Array:
    """Converts a result of the task's method `method` to a new array (num_envs,) of type `dtype`, float64 or bool."""
    kind = type(task).__name__
    try:
        array = np.array(values, dtype=None if dtype is bool else dtype)
    except ValueError:  # Rows of different lengths, such as a tuple of an array and a dictionary.
        raise ValueError(
            f"{kind}.{method} returns {in_words(values)}, must be an array ({num_envs},): one value for each environment"
        ) from None
    if array.shape != (num_envs,):
        raise ValueError(f"{kind}.{method} returns an array of shape {array.shape}, must be ({num_envs},): one value for each environment")
    if dtype is bool and array.dtype.kind != "b":
        raise ValueError(f"{kind}.{method} returns an array of {array.dtype}, must be of bool, as now.qpos[:, 0] < 0.2")
    return array
