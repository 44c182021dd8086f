"""States of some environments of a stepper, by their indices: copied, kept, given to another stepper; resets, steps and rollouts of some.

    import stepper

    sim = stepper.Stepper(stepper.load("humanoid.xml"), 256)
    stepper.states.copy(sim, sources)  # environment k goes on from where environment sources[k] is
    kept = stepper.states.save(sim, [3, 5])
    stepper.states.restore(other, kept, [0, 1])  # another stepper of the same model

All is made of `Stepper.get_state` and `Stepper.set_state`: a state is everything that survives a step, and who goes on from it repeats the
same bits. Parameters of `Stepper.randomize` and forces that are applied are no part of it, and stay with their environments. Where
environments have the state of another, their sensors draw random numbers of their own from then on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._stepper import State, Stepper

Array = NDArray[Any]
Envs: TypeAlias = ArrayLike | slice
"""Which environments: indices (n,), each once, a slice, or a mask (num_envs,) bool."""


def indices(sim: Stepper, envs: Envs | None, name: str = "envs") -> NDArray[np.int64]:
    """Indices of environments, (n,), in the order given; None is all.

    Args:
        sim: The stepper.
        envs: Which environments.
        name: What messages call them.

    Raises:
        ValueError: A stepper of one environment without an axis, a mask of another length, an index twice.
        TypeError: Indices that are no whole numbers.
        IndexError: An index that there is not.
    """
    if sim.num_envs is None:
        raise ValueError("the stepper has one environment and no axis of environments: make it with num_envs=1 or more")
    every = np.arange(sim.num_envs)
    if envs is None:
        return every
    if isinstance(envs, slice):
        return every[envs]
    given = np.atleast_1d(np.asarray(envs))
    if given.dtype == np.bool_:
        if given.shape != every.shape:
            raise ValueError(f"{name} is a mask of shape {given.shape}, must be ({sim.num_envs},)")
        return np.flatnonzero(given)
    _check_indices(sim, given, name)
    unique, counts = np.unique(given, return_counts=True)
    if (counts > 1).any():
        raise ValueError(f"{name} has environment {unique[counts > 1][0]} more than once")
    return given.astype(np.int64)


def mask(sim: Stepper, envs: Envs) -> NDArray[np.bool_]:
    """Environments as a mask, (num_envs,) bool, as `Stepper.reset`, `set_state` and `randomize` take it.

    Raises:
        ValueError, TypeError, IndexError: As of `indices`.
    """
    found = np.zeros(sim.num_envs or 1, dtype=bool)
    found[indices(sim, envs)] = True
    return found


def copy(sim: Stepper, sources: ArrayLike, envs: Envs | None = None) -> None:
    """Environments take over the states of others: of resampling, of a population, of the best plan.

    Args:
        sim: The stepper.
        sources: Whose state each of them takes, indices (n,), or one for all. All are read before any is changed.
        envs: Who takes them, n environments; None is all.

    Raises:
        ValueError: As many sources as there are not environments; as of `indices`.
        TypeError, IndexError: As of `indices`.
    """
    targets = indices(sim, envs)
    given = np.asarray(sources)
    _check_indices(sim, np.atleast_1d(given), "sources")
    if given.ndim and given.shape != targets.shape:
        raise ValueError(f"sources has shape {given.shape}, must be one index or ({len(targets)},): one for each environment that takes it")
    whose = np.broadcast_to(given, targets.shape)
    moved = whose != targets
    unique, which = np.unique(whose[moved], return_inverse=True)
    states = [sim.get_state(int(source)) for source in unique]
    _give(sim, states, which, targets[moved])


def save(sim: Stepper, envs: Envs | None = None) -> list[State]:
    """States of some environments, one for each, which pickle and compare by bits.

    Raises:
        ValueError, TypeError, IndexError: As of `indices`.
    """
    return [sim.get_state(int(env)) for env in indices(sim, envs)]


def restore(sim: Stepper, states: State | Sequence[State], envs: Envs | None = None) -> None:
    """Gives environments states that `save` or `Stepper.get_state(env)` kept, of this stepper or of another of the same model.

    Args:
        sim: The stepper.
        states: A state for each environment, or one for all.
        envs: Who takes them; None is all.

    Raises:
        ValueError: As many states as there are not environments, a state of another model; as of `indices`.
        TypeError, IndexError: As of `indices`.
    """
    targets = indices(sim, envs)
    if isinstance(states, State):
        _give(sim, [states], np.zeros(len(targets), dtype=np.int64), targets)
        return
    given = list(states)
    if len(given) != len(targets):
        raise ValueError(f"there are {len(given)} states, must be {len(targets)}: one for each environment that takes it, or one for all")
    digest = bytes.fromhex(sim.model.digest)
    for k, state in enumerate(given):  # All are looked at before any environment changes.
        if state.digest != digest:
            raise ValueError(f"state {k} is of another model than the stepper's: give states of steppers of the same model")
    # Those that are the same are set in one call.
    places: dict[bytes, int] = {}
    which = np.array([places.setdefault(state.bytes, len(places)) for state in given], dtype=np.int64)
    unique = {place: state for state, place in zip(given, which.tolist(), strict=True)}
    _give(sim, [unique[k] for k in range(len(unique))], which, targets)


def reset(
    sim: Stepper,
    envs: Envs,
    *,
    qpos: ArrayLike | None = None,
    qvel: ArrayLike | None = None,
    seed: ArrayLike | None = None,
    keyframe: str | int | None = None,
) -> None:
    """`Stepper.reset` of some environments by their indices.

    Args:
        sim: The stepper.
        envs: The n environments that begin.
        qpos: Where they start, (n, nq) or (nq,); None is the model's reference.
        qvel: How fast, (n, nv) or (nv,); None is at rest.
        seed: A new seed of the errors of their sensors, or (n,); None keeps the old ones.
        keyframe: Name or index of a keyframe to start from.

    Raises:
        ValueError, TypeError, IndexError, KeyError: As of `indices` and of `Stepper.reset`.
    """
    which = indices(sim, envs)
    chosen = np.zeros(sim.num_envs or 1, dtype=bool)
    chosen[which] = True
    rows = {name: _scattered(sim, which, value, name, 1) for name, value in (("qpos", qpos), ("qvel", qvel)) if value is not None}
    if seed is not None:
        rows["seed"] = _scattered(sim, which, seed, "seed", 0)
    sim.reset(chosen, keyframe=keyframe, **rows)


def step(sim: Stepper, ctrl: ArrayLike | None, envs: Envs, nstep: int = 1) -> None:
    """Makes steps of some environments; the others stay as they are, to the bit.

    `Stepper.step` by indices. Of a stepper that is recorded all are stepped, and the others are given back their states, which a
    recording repeats. Whoever always steps the same blocks has them as a `stepper.adapters.envpool.StepperPool`, too.

    Args:
        sim: The stepper.
        ctrl: Controls of the n environments, (n, nu) or (nu,) for all of them; None holds those in force.
        envs: The n environments.
        nstep: Number of steps.

    Raises:
        ValueError, TypeError, IndexError, KeyboardInterrupt: As of `indices` and of `Stepper.step`.
    """
    which = indices(sim, envs)
    others = np.ones(sim.num_envs or 1, dtype=bool)
    others[which] = False
    controls = None
    if ctrl is not None:
        controls = np.array(sim.ctrl, dtype=np.float64)
        controls[which] = _rows(which, ctrl, "ctrl", 1)
    if not others.any():
        sim.step(controls, nstep)
        return
    if sim.recorder is None:
        sim.step(controls, nstep, mask=~others)
        return
    before = sim.get_state()
    try:
        sim.step(controls, nstep)
    finally:
        sim.set_state(before, mask=others)


def rollout(
    sim: Stepper,
    ctrl: ArrayLike,
    nstep: int = 1,
    *,
    initial: State | Sequence[State],
    fields: Sequence[str] | None = None,
    out: dict[str, Array] | None = None,
) -> dict[str, Array]:
    """`Stepper.rollout` from states of one's own: what a planner asks of its model.

    Args:
        sim: The stepper, whose environments are at the end of their rollouts after it.
        ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
        nstep: Steps that each control is held.
        initial: Where it begins: the state of one environment for all (`plant.get_state()`), of all, or a sequence with one for each.
        fields: What to write down after every control, as of `Stepper.rollout`.
        out: Arrays to write into, by field.

    Returns:
        The arrays by field, as of `Stepper.rollout`.

    Raises:
        ValueError, TypeError, KeyboardInterrupt: As of `restore` and of `Stepper.rollout`.
    """
    if isinstance(initial, State):
        sim.set_state(initial)
    else:
        restore(sim, initial)
    return sim.rollout(ctrl, nstep, fields=fields, out=out)


def _give(sim: Stepper, states: list[State], which: Array, targets: Array) -> None:
    """Environments `targets` (n,) take the states of their numbers `which` (n,)."""
    chosen = np.zeros(sim.num_envs or 1, dtype=bool)
    for k, state in enumerate(states):
        chosen[:] = False
        chosen[targets[which == k]] = True
        sim.set_state(state, mask=chosen)


def _check_indices(sim: Stepper, given: Array, name: str) -> None:
    if given.ndim != 1 or not (np.issubdtype(given.dtype, np.integer) or given.size == 0):
        raise TypeError(f"{name} has shape {given.shape} and type {given.dtype}, must be indices of environments, whole numbers (n,)")
    beyond = given[(given < 0) | (given >= (sim.num_envs or 0))]
    if beyond.size:
        raise IndexError(f"{name} has {beyond[0]}, there are environments 0 to {(sim.num_envs or 0) - 1}")


def _rows(which: Array, value: ArrayLike, name: str, axes: int) -> Array:
    """A row for each of n environments: as given, or one for all."""
    given = np.asarray(value)
    if given.ndim not in (axes, axes + 1) or (given.ndim == axes + 1 and len(given) != len(which)):
        raise ValueError(f"{name} has shape {given.shape}, must have {len(which)} rows, one for each environment, or be one for all")
    return np.broadcast_to(given, (len(which), *given.shape[given.ndim - axes :]))


def _scattered(sim: Stepper, which: Array, value: ArrayLike, name: str, axes: int) -> Any:
    """Rows of n environments as an array of all, whose other rows nobody reads."""
    rows = _rows(which, value, name, axes)
    # Rows of the others must be fit to be read: the reference has a unit quaternion, and 0 is a number.
    rest = np.asarray(sim.model.qpos0 if name == "qpos" else np.zeros(rows.shape[1:]), dtype=rows.dtype if axes == 0 else np.float64)
    if rest.shape != rows.shape[1:]:
        raise ValueError(f"{name} has rows of shape {rows.shape[1:]}, must have {rest.shape}")
    every = np.tile(rest, (sim.num_envs or 1, *[1] * axes))
    every[which] = rows
    return every
