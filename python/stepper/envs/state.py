"""Saving and restoring of environments: state of the stepper, its parameters, and the running episodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import State, Stepper
from stepper.envs.task import Task
from stepper.shared.fields import APPLIED

Array = NDArray[Any]

_DECISIVE = ("task", "precision")
"""Settings on which other settings depend. If one of these differs, the error message lists only this difference."""
_LISTED = 3
"""Largest number of differing settings that an error message lists."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvState:
    """State of a `StepperVectorEnv` or `StepperEnv`, returned by `get_state`. It can be pickled.

    Attributes:
        sim: State of the stepper.
        parameters: Parameters of `Stepper.randomize`, by name.
        applied: Applied forces, poses of mocap bodies and active equalities, by name; None for arrays that were never used.
        episodes: Values of the episodes by name, (num_envs, ...) each: the task's episode_state, random numbers, return, length,
            last action.
        settings: Settings that the state depends on, by name: the task, its arguments, precision and options of the step.
    """

    sim: State
    parameters: dict[str, Any]
    applied: dict[str, Array | None]
    episodes: dict[str, Array]
    settings: dict[str, Any]


def save(sim: Stepper, task: Task, episodes: dict[str, Array], weights: Mapping[str, float]) -> EnvState:
    """State of all environments of a stepper, for `restore`.

    Args:
        sim: The stepper.
        task: The task of the environments.
        episodes: Arrays (num_envs, ...) of the running episodes, by name, which are copied.
        weights: Weights of the reward terms, by name.
    """
    pickled = sim.__getstate__()
    # These arrays are not read as attributes: the first access to sim.xfrc_applied etc. creates an array that every later step must read.
    applied = {name: None if array is None else np.array(array) for name, array in zip(APPLIED, pickled["applied"], strict=True)}
    if np.size(sim.mocap_pos):
        applied |= {name: np.array(getattr(sim, name)) for name in ("mocap_pos", "mocap_quat")}
    parameters = {name: value if name == "actuators" else np.array(value) for name, value in pickled["randomized"].items()}
    return EnvState(
        sim=State(pickled["state"]),
        parameters=parameters,
        applied=applied,
        episodes={name: np.array(values) for name, values in episodes.items()},
        settings=_settings(sim, task, weights),
    )


def check_settings(sim: Stepper, task: Task, state: EnvState, weights: Mapping[str, float]) -> None:
    """Checks that a state was saved with the same task, arguments of the task, precision and options of the step.

    Otherwise the saved returns, episode_state and random numbers would belong to another reward or another motion.
    """
    present, saved = _settings(sim, task, weights), state.settings
    absent = object()
    names = [name for name in {**saved, **present} if not _equal(saved.get(name, absent), present.get(name, absent))]
    if not names:
        return
    decisive = names[0] in _DECISIVE
    shown = names[:1] if decisive else names[:_LISTED]
    more = "" if decisive or len(names) <= _LISTED else f"; and {len(names) - _LISTED} more"
    listed = "; ".join(f"{name} was {_shown(saved, name)} and is {_shown(present, name)} here" for name in shown)
    motion = "" if decisive else ", or restore only the state of the stepper with sim.set_state(state.sim)"
    raise ValueError(
        f"the state is from an environment with other settings: {listed}{more}. Make an environment with the settings of the state{motion}"
    )


def _shown(settings: dict[str, Any], name: str) -> str:
    """Value of a setting as text for an error message; "absent" if there is no setting of this name."""
    return repr(settings[name]) if name in settings else "absent"


def _settings(sim: Stepper, task: Task, weights: Mapping[str, float]) -> dict[str, Any]:
    """Settings that a saved state depends on, by name: task, its arguments, weights of the reward, precision and options of the step.

    Values that cannot be compared, such as functions, are left out.
    """
    options = asdict(sim.options) | {"timestep": sim.timestep, "tolerance": float(sim.tolerance)}
    names = [field.name for field in fields(task)] if is_dataclass(task) else [name for name in vars(task) if name[0] != "_"]
    arguments = {name: getattr(task, name) for name in names}
    found = {"task": type(task).__qualname__, "precision": sim.precision, **options}
    return found | dict(_plain(f"{type(task).__name__}.", arguments)) | {f"rewards.{name}": weight for name, weight in weights.items()}


def _plain(prefix: str, values: Mapping[Any, Any]) -> Iterator[tuple[str, Any]]:
    """Yields numbers, strings and arrays of nested mappings, sequences and dataclasses, with dotted names that begin with `prefix`."""
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, np.ndarray):
            yield name, value.copy()
        elif value is None or isinstance(value, bool | int | float | str | np.generic):
            yield name, value
        elif is_dataclass(value) and not isinstance(value, type):
            yield from _plain(f"{name}.", {field.name: getattr(value, field.name) for field in fields(value)})
        elif isinstance(value, Mapping):
            yield from _plain(f"{name}.", value)
        elif isinstance(value, tuple | list):
            yield from _plain(f"{name}.", dict(enumerate(value)))


def restore(sim: Stepper, state: EnvState, mask: Array) -> None:
    """Restores the state, parameters and applied forces of the environments in a mask (num_envs,) from a saved state.

    Raises:
        ValueError: The state is from another model or precision. Nothing is changed.
    """
    sim.set_state(state.sim, envs=mask)
    _restore_parameters(sim, state.parameters, mask)
    used = sim.__getstate__()["applied"]
    for name, array in zip(APPLIED, used, strict=True):
        rows = state.applied[name]
        if rows is not None:
            getattr(sim, name)[mask] = rows[mask]
        elif array is not None:
            array[mask] = sim.model.eq_active0 if name == "eq_active" else 0.0


def _restore_parameters(sim: Stepper, parameters: dict[str, Any], mask: Array) -> None:
    """Restores the randomized parameters of the environments in a mask (num_envs,). Fields absent in `parameters` get the model's value."""
    now = sim.randomized
    fields = {name: parameters.get(name) for name in {*now, *parameters}}
    changed = {name: value for name, value in fields.items() if not _same(value, now.get(name), mask)}
    if changed:
        sim.randomize(mask, **changed)


def _equal(one: Any, other: Any) -> bool:
    """Whether two settings are equal. Arrays are equal if their types, shapes and bytes are equal. NaN equals NaN."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return type(one) is type(other) and one.dtype == other.dtype and one.tobytes() == other.tobytes() and one.shape == other.shape
    return bool(one == other) or repr(one) == repr(other)


def _same(one: Any, other: Any, mask: Array) -> bool:
    """Whether two values of a randomized parameter are equal in the environments of a mask (num_envs,). A value may be None."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one[mask], other[mask])
    return type(one) is type(other) and bool(one == other)
