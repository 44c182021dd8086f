"""Rollouts of a stepper as a differentiable function for JAX (docs/how-to/derivatives.md)."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stepper._stepper import Stepper
from stepper.derivatives.perturbations import STATE, check_parameters
from stepper.derivatives.rollout import Rollout, rollout as make
from stepper.shared.machine import require

jax = require("jax", "for stepper.adapters.jax_rollout")


def rollout(
    sim: Stepper, nstep: int = 1, *, parameters: Sequence[str] = (), every: int | None = None, sensors: bool = False, **settings: Any
) -> Callable[..., dict[str, Any]]:
    """Makes a JAX function that steps copies of a stepper and can be differentiated in reverse mode.

    The function works under `jax.jit` and `jax.grad`; it calls the stepper through `jax.pure_callback`. The backward pass repeats the
    rollout and computes `stepper.derivatives.Rollout.vjp`. Arrays are float64 with `jax_enable_x64`, and otherwise float32. Steps have the
    precision of the stepper.

    Args:
        sim: The stepper, which is copied. The rollout has the model and all settings of the stepper, but starts from the given state.
        nstep: Number of steps for which each control is held.
        parameters: Selectors of the parameters that become arguments of the function, so that it can be differentiated with respect to
            them.
        every: Number of controls between two checkpoints, see `stepper.derivatives.rollout`.
        sensors: Whether to compute readings of ideal sensors.
        **settings: Arguments of `stepper.derivatives.Rollout.vjp`: `smoothing`, `step`, `tolerance`, `centered` and `extrapolate`.

    Returns:
        Function f(ctrl, qpos, qvel, act, *parameters). Arguments are controls, (T, num_envs, nu) or (T, nu), the initial state,
        (num_envs, nq), (num_envs, nv) and (num_envs, na), and values of each of `parameters`, (num_envs, ...). The result is a dictionary
        with "qpos", "qvel" and "act" after the steps of each control, (T, num_envs, ...), and "sensors" if requested. Delays and integrals
        of drives are reset. The function raises a TypeError for another number of arrays, or for another type than float32 or float64.

    Raises:
        TypeError, ValueError: `parameters` has an entry that is no selector of the stepper's model.
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
        cotangents: dict[str, Any] = {name: np.asarray(gradients[name], np.float64) for name in names}
        found = made(*given).vjp(**cotangents, **settings)
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
                raise TypeError(f"{name} has dtype {array.dtype}, must be float32 or float64: convert it with {name}.astype(float)")
        # Broadcast outside of the custom rule, so that JAX adds the gradients of all environments.
        if original.num_envs is not None and arrays[0].ndim == 2:
            arrays[0] = jax.numpy.broadcast_to(arrays[0][:, None], (len(arrays[0]), original.num_envs, arrays[0].shape[1]))
        found: dict[str, Any] = ruled(*arrays)
        return found

    return function
