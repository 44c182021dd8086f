"""Rollouts of a stepper as a function of JAX that has a derivative (docs/how-to/derivatives.md)."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stepper._stepper import Stepper
from stepper.derivatives.perturbations import STATE, check_parameters
from stepper.derivatives.rollout import Rollout
from stepper.derivatives.rollout import rollout as make
from stepper.shared.machine import require

jax = require("jax", "for stepper.adapters.jax_rollout")


def rollout(
    sim: Stepper, nstep: int = 1, *, parameters: Sequence[str] = (), every: int | None = None, sensors: bool = False, **settings: Any
) -> Callable[..., dict[str, Any]]:
    """A function of JAX that makes steps on copies of a stepper, with a rule for reverse differentiation.

    It works under `jax.jit` and `jax.grad`: JAX calls back into the stepper (`jax.pure_callback`). The way back makes the rollout once
    more, and takes it from the last control to the first (`stepper.derivatives.Rollout.vjp`). Numbers are float64 with
    `jax_enable_x64`, and float32 without; steps are made in the stepper's own precision.

    Args:
        sim: The stepper; what is made of it begins with a copy, which has all but the state from it.
        nstep: Steps that each control is held.
        parameters: Parameters to differentiate by, as selectors.
        every: Controls between two checkpoints, see `stepper.derivatives.rollout`.
        sensors: Whether readings of ideal sensors are wanted.
        **settings: Those of `stepper.derivatives.Rollout.vjp`: `smoothing`, `step`, `tolerance`, `centered` and `extrapolate`.

    Returns:
        f(ctrl, qpos, qvel, act, *parameters) of arrays (T, num_envs, nu) or, for all environments, (T, nu), then (num_envs, nq),
        (num_envs, nv), (num_envs, na) and, for each name of `parameters`, (num_envs, ...). It gives "qpos", "qvel" and "act" after every
        control, (T, num_envs, ...), and "sensors" if they are wanted. A state that is given begins without the memory of drives. It raises
        TypeError for another number of arrays, and for one that is neither float32 nor float64.

    Raises:
        TypeError, ValueError: `parameters` that are no selectors of the stepper's model.
    """
    check_parameters(sim.model, parameters)
    original = copy.deepcopy(sim)
    names = ("qpos", "qvel", "act", *(("sensors",) if sensors else ()))
    sizes = {"qpos": sim.model.nq, "qvel": sim.model.nv, "act": sim.model.na, "sensors": sim.model.nsensordata}

    def made(ctrl: Any, qpos: Any, qvel: Any, act: Any, *own: Any) -> Rollout:
        plant = copy.deepcopy(original)
        if own:
            plant.randomize({name: np.asarray(value, np.float64) for name, value in zip(parameters, own, strict=True)})
        plant.set_state(np.asarray(qpos, np.float64), np.asarray(qvel, np.float64), act=np.asarray(act, np.float64))
        return make(plant, np.asarray(ctrl, np.float64), nstep, parameters=parameters, every=every, sensors=sensors)

    def forwards(*given: Any) -> dict[str, Any]:
        result = made(*given)
        return {name: np.asarray(getattr(result, name), given[0].dtype) for name in names}

    def backwards(gradients: dict[str, Any], *given: Any) -> tuple[Any, ...]:
        asked: dict[str, Any] = {name: np.asarray(gradients[name], np.float64) for name in names}
        found = made(*given).vjp(**asked, **settings)
        own = (found.ctrl, found.qpos, found.qvel, found.act, *(found.parameters[name] for name in parameters))
        return tuple(np.asarray(array, like.dtype) for array, like in zip(own, given, strict=True))

    def call(*given: Any) -> Any:
        kind, lead = given[0].dtype, given[0].shape[:-1]
        shapes = {name: jax.ShapeDtypeStruct((*lead, sizes[name]), kind) for name in names}
        return jax.pure_callback(forwards, shapes, *given)

    def pull(given: tuple[Any, ...], gradients: dict[str, Any]) -> Any:
        shapes = tuple(jax.ShapeDtypeStruct(array.shape, array.dtype) for array in given)
        return jax.pure_callback(backwards, shapes, gradients, *given)

    ruled: Any = jax.custom_vjp(call)
    ruled.defvjp(lambda *given: (call(*given), given), pull)
    arguments = ("ctrl", *STATE, *parameters)

    def function(*given: Any) -> dict[str, Any]:
        if len(given) != len(arguments):
            raise TypeError(f"the rollout takes {len(arguments)} arrays, {', '.join(arguments)}; {len(given)} were given")
        arrays = [jax.numpy.asarray(value) for value in given]
        for name, array in zip(arguments, arrays, strict=True):
            if array.dtype not in (np.float32, np.float64):
                raise TypeError(f"{name} has dtype {array.dtype}, must be float32 or float64: convert it, as {name}.astype(float)")
        # Spread outside the rule, so that JAX adds the gradients of all environments.
        if original.num_envs is not None and arrays[0].ndim == 2:
            arrays[0] = jax.numpy.broadcast_to(arrays[0][:, None], (len(arrays[0]), original.num_envs, arrays[0].shape[1]))
        found: dict[str, Any] = ruled(*arrays)
        return found

    return function
