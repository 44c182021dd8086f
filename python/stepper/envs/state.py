"""States of environments: state of the stepper, its parameters, and the running episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import State, Stepper

Array = NDArray[Any]

_APPLIED = ("qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat", "eq_active")
"""Writable arrays of a stepper, in the order of its pickles."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvState:
    """State of a `StepperVectorEnv` or `StepperEnv`, returned by `get_state`. It pickles.

    Attributes:
        sim: State of the stepper.
        parameters: Parameters of `Stepper.randomize`, by name.
        applied: Applied forces, poses of mocap bodies and active equalities, by name; None for arrays that were never used.
        episodes: Values of the episodes by name, (num_envs, ...) each: memory of the task, random numbers, return, length, last action.
    """

    sim: State
    parameters: dict[str, Any]
    applied: dict[str, Array | None]
    episodes: dict[str, Array]


def save(sim: Stepper, episodes: dict[str, Array]) -> EnvState:
    """State of a stepper with copies of the values of its episodes."""
    pickled = sim.__getstate__()
    # Attributes of the stepper would make arrays that every step reads from then on.
    applied = {name: None if array is None else np.array(array) for name, array in zip(_APPLIED, pickled["applied"], strict=True)}
    if np.size(sim.mocap_pos):
        applied |= {name: np.array(getattr(sim, name)) for name in ("mocap_pos", "mocap_quat")}
    parameters = {name: value if name == "actuators" else np.array(value) for name, value in pickled["randomized"].items()}
    return EnvState(
        sim=State(pickled["state"]),
        parameters=parameters,
        applied=applied,
        episodes={name: np.array(values) for name, values in episodes.items()},
    )


def restore(sim: Stepper, state: EnvState, mask: Array) -> None:
    """Restores the stepper's state, parameters and applied forces of environments in a mask (num_envs,).

    Raises:
        ValueError: The state is from another model or precision. Nothing is changed.
    """
    sim.set_state(state.sim, mask=mask)
    _restore_parameters(sim, state.parameters, mask)
    used = sim.__getstate__()["applied"]
    for name, array in zip(_APPLIED, used, strict=True):
        rows = state.applied[name]
        if rows is not None:
            getattr(sim, name)[mask] = rows[mask]
        elif array is not None:
            array[mask] = sim.model.eq_active0 if name == "eq_active" else 0.0


def _restore_parameters(sim: Stepper, parameters: dict[str, Any], mask: Array) -> None:
    """Restores the parameters of environments in a mask; None is the model's value."""
    now = sim.randomized
    fields = {name: parameters.get(name) for name in {*now, *parameters}}
    changed = {name: value for name, value in fields.items() if not _same(value, now.get(name), mask)}
    if changed:
        sim.randomize(mask, **changed)


def _same(one: Any, other: Any, mask: Array) -> bool:
    """Whether two parameters, either of which may be None, agree in the environments of a mask."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one[mask], other[mask])
    return type(one) is type(other) and bool(one == other)
