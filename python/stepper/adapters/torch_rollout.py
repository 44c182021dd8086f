"""Rollouts of a stepper as a differentiable function for PyTorch (docs/how-to/derivatives.md)."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from stepper._stepper import Stepper
from stepper.derivatives.perturbations import STATE, check_parameters
from stepper.derivatives.rollout import Rollout, rollout as make
from stepper.shared.machine import require

require("torch", "for stepper.adapters.torch_rollout")

import torch  # noqa: E402


class States(NamedTuple):
    """States of a rollout: one for each of the T controls, after the steps with this control.

    Attributes:
        qpos: Positions, (T, num_envs, nq), m and rad.
        qvel: Velocities, (T, num_envs, nv), m/s and rad/s.
        act: Activations, (T, num_envs, na).
        sensors: Readings of ideal sensors, (T, num_envs, nsensordata); (T, num_envs, 0) without `sensors=True`.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    act: torch.Tensor
    sensors: torch.Tensor


def rollout(
    sim: Stepper,
    ctrl: torch.Tensor,
    nstep: int = 1,
    *,
    qpos: torch.Tensor | None = None,
    qvel: torch.Tensor | None = None,
    act: torch.Tensor | None = None,
    parameters: Mapping[str, torch.Tensor] | None = None,
    every: int | None = None,
    sensors: bool = False,
    **settings: Any,
) -> States:
    """Makes `nstep` steps with each of T controls on a copy of a stepper; gradients flow to every input tensor.

    The backward pass is `stepper.derivatives.Rollout.vjp`: linearizations of the steps of each control, with
    checkpoints. Gradients with respect to quaternions are tangent to the unit sphere. There is no second derivative.

    Args:
        sim: The stepper; it does not change. The rollout starts from its state, except for the parts given below.
        ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments, in their units; float32 or float64. Results have the same type
            and device.
        nstep: Number of steps for which each control is held.
        qpos: Initial positions, (num_envs, nq), m and rad; None takes those of the stepper. If a part of the state is given, delays and
            integrals of drives are reset.
        qvel: Initial velocities, (num_envs, nv), m/s and rad/s; None takes those of the stepper.
        act: Initial activations, (num_envs, na), in their units; None takes those of the stepper.
        parameters: Values by selector, as for `Stepper.randomize`, each (num_envs, ...).
        every: Number of controls between two checkpoints, see `stepper.derivatives.rollout`.
        sensors: Whether to compute readings of ideal sensors.
        **settings: Arguments of `stepper.derivatives.Rollout.vjp`: `smoothing`, `step`, `tolerance`, `centered` and `extrapolate`.

    Raises:
        TypeError: A tensor is neither float32 nor float64.
        ValueError: A wrong shape, a number that is not finite, or an unknown parameter.
        ModelError: The values of the parameters are not valid for a model, such as a negative mass.
    """
    given = dict(zip(STATE, (qpos, qvel, act), strict=True))
    names = tuple(parameters or {})
    check_parameters(sim.model, names)
    for name, tensor in {"ctrl": ctrl, **given, **(parameters or {})}.items():
        if tensor is not None and tensor.dtype not in (torch.float32, torch.float64):
            raise TypeError(f"{name} has dtype {tensor.dtype}, must be torch.float32 or torch.float64: convert it with {name}.double()")
    # Broadcast with autograd, so that it adds the gradients of all environments.
    if sim.num_envs is not None and ctrl.ndim == 2:
        ctrl = ctrl[:, None].expand(-1, sim.num_envs, -1)
    tensors = [ctrl, *given.values(), *(parameters or {}).values()]
    plan = _Plan(sim, nstep, names, every, sensors, settings)
    return States(*_Rollout.apply(plan, *tensors))


class _Plan(NamedTuple):
    """Arguments of `rollout` that are not tensors; `parameters` contains the selectors of the parameters."""

    sim: Stepper
    nstep: int
    parameters: Sequence[str]
    every: int | None
    sensors: bool
    settings: dict[str, Any]

    def make(self, ctrl: Any, state: Sequence[Any], parameters: Sequence[Any]) -> Rollout:
        """Differentiable rollout of a copy of the stepper.

        Args:
            ctrl: Controls in the actuators' units: (T, nu), or (T, num_envs, nu) for a batch.
            state: Initial qpos, qvel and act, each (num_envs, ...); None keeps the stepper's value.
            parameters: Values of the selectors in `self.parameters`, each (num_envs, ...).
        """
        plant = copy.deepcopy(self.sim)
        if parameters:
            plant.randomize(dict(zip(self.parameters, parameters, strict=True)))
        given = {name: value for name, value in zip(STATE, state, strict=True) if value is not None}
        if given:
            plant.set_state(**given)
        return make(plant, ctrl, self.nstep, parameters=self.parameters, every=self.every, sensors=self.sensors)


class _Rollout(torch.autograd.Function):  # type: ignore[misc]
    """Rollout as an operation of PyTorch's autograd.

    The arguments are a `_Plan` and tensors: controls, qpos, qvel, act, and values of parameters. The results are the fields of `States`.
    """

    @staticmethod
    def forward(ctx: Any, plan: _Plan, *tensors: torch.Tensor | None) -> tuple[torch.Tensor, ...]:
        arrays = [None if t is None else t.detach().cpu().numpy().astype(np.float64) for t in tensors]
        made = plan.make(arrays[0], arrays[1:4], arrays[4:])
        ctx.made, ctx.plan, ctx.like = made, plan, [None if t is None else (t.dtype, t.device) for t in tensors]
        first = tensors[0]
        assert first is not None
        readings = made.sensors if made.sensors is not None else np.zeros((*made.act.shape[:-1], 0))
        out = tuple(torch.from_numpy(array).to(first) for array in (made.qpos, made.qvel, made.act, readings))
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[Any, ...]:
        arrays = [g.detach().cpu().numpy().astype(np.float64) for g in gradients]
        found = ctx.made.vjp(
            qpos=arrays[0], qvel=arrays[1], act=arrays[2], sensors=arrays[3] if ctx.plan.sensors else None, **ctx.plan.settings
        )
        own = [found.ctrl, found.qpos, found.qvel, found.act, *(found.parameters[name] for name in ctx.plan.parameters)]
        like = zip(own, ctx.like, strict=True)
        return (None, *(None if kind is None else torch.from_numpy(array).to(dtype=kind[0], device=kind[1]) for array, kind in like))
