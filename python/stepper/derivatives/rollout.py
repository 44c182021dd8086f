"""Vector-Jacobian products of rollouts: checkpoints of states are stored, and derivative matrices are recomputed in the backward pass."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper._stepper import Model, State, Stepper
from stepper.derivatives.copies import rows
from stepper.derivatives.kinks import Bools
from stepper.derivatives.linearize import Linearization, first_undetermined, linearize
from stepper.derivatives.perturbations import STATE, Array, check_parameters
from stepper.derivatives.smoothing import Smoothing, smoothed
from stepper.shared.arguments import check_flag, check_kind, check_whole
from stepper.shared.selectors import parse


@functools.lru_cache(maxsize=8)
def _places(model: Model) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Indices of rotations and of all other coordinates in qpos and in qvel.

    Returns:
        Indices in qpos and in qvel of all coordinates except rotations, (k,) each. Indices of quaternions in qpos, (count, 4), and of the
        corresponding angular velocities in qvel, (count, 3).
    """
    plain, turned = [], []
    for k in range(model.njnt):
        joint = model.joint(k)
        shifts = {"free": 3, "ball": 0}.get(joint.type, 1)
        plain += [(joint.qposadr + i, joint.dofadr + i) for i in range(shifts)]
        if joint.type in ("free", "ball"):
            turned.append((joint.qposadr + shifts, joint.dofadr + shifts))
    q, v = np.array(plain, dtype=np.int64).reshape(-1, 2).T
    quat, rotation = np.array(turned, dtype=np.int64).reshape(-1, 2).T
    return q, v, quat[:, None] + np.arange(4), rotation[:, None] + np.arange(3)


def _rates(quat: Array) -> Array:
    """Derivative of the quaternion q * exp(r / 2) with respect to the rotation vector r in the body's frame, at r = 0.

    The shape is (..., 4, 3), the unit is 1/rad. `quat` is the unit quaternion q, (..., 4). Twice the derivative has orthonormal columns.
    """
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rates: Array = 0.5 * np.stack([-x, -y, -z, w, -z, y, z, w, -x, -y, x, w], axis=-1).reshape(*quat.shape[:-1], 4, 3)
    return rates


def to_tangent(model: Model, qpos: Array, gradient: Array) -> Array:
    """Converts a gradient with respect to the entries of qpos, (..., nq), to a gradient in tangent coordinates, (..., nv)."""
    q, v, quat, rotation = _places(model)
    out = np.zeros((*gradient.shape[:-1], model.nv))
    out[..., v] = gradient[..., q]
    if len(quat):
        out[..., rotation] = np.einsum("...ij,...i->...j", _rates(qpos[..., quat]), gradient[..., quat])
    return out


def from_tangent(model: Model, qpos: Array, gradient: Array) -> Array:
    """Converts a gradient in tangent coordinates, (..., nv), to a gradient with respect to the entries of qpos, (..., nq).

    The result is orthogonal to the quaternions in qpos.
    """
    q, v, quat, rotation = _places(model)
    out = np.zeros((*gradient.shape[:-1], model.nq))
    out[..., q] = gradient[..., v]
    if len(quat):
        out[..., quat] = 4.0 * np.einsum("...ij,...j->...i", _rates(qpos[..., quat]), gradient[..., rotation])
    return out


OUTPUTS = (*STATE, "sensors")


@dataclass(frozen=True)
class Gradients:
    """Gradients of a scalar function of a rollout, returned by `Rollout.vjp`. With `num_envs=None` the axis of the environments is absent.

    Attributes:
        qpos: Gradient with respect to the initial qpos, (num_envs, nq). The gradient of a quaternion is orthogonal to the quaternion.
        qvel: Gradient with respect to the initial qvel, (num_envs, nv).
        act: Gradient with respect to the initial act, (num_envs, na).
        ctrl: Gradient with respect to the controls, (T, num_envs, nu).
        parameters: Gradients with respect to the parameters, (num_envs, *shape) each. The keys are the names given to `rollout`.
        near_kink: Whether the steps with each control are near a kink, (T, num_envs) bool; see `Linearization`. Their derivatives are then
            those for the active constraints of the actual steps.
        undetermined: Whether a step of an environment has no derivative, (num_envs,) bool. All gradients of the environment are then 0.
    """

    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    parameters: dict[str, Array]
    near_kink: Bools
    undetermined: Bools


class Rollout:
    """Rollout with its states and derivatives; created by `rollout`.

    Attributes:
        qpos, qvel, act: States after the steps of each control, (T, num_envs, ...), m and rad, m/s and rad/s, units of the activations.
        sensors: Readings of ideal sensors after the steps of each control, (T, num_envs, nsensordata); None unless the
            rollout was made with `sensors=True`.
        every: Number of controls between two checkpoints.
    """

    def __init__(self, sim: Stepper, ctrl: Array, nstep: int, *, parameters: Sequence[str], every: int | None, sensors: bool):
        self._plant, self._ctrl, self._nstep, self._parameters = sim, ctrl, nstep, tuple(parameters)
        self._sensors = sensors
        T = len(ctrl)
        self.every = max(1, round(math.sqrt(T))) if every is None else every
        self._start = {name: rows(sim, name).astype(np.float64) for name in STATE}
        self._checkpoints: list[State] = []
        states: dict[str, list[NDArray[Any]]] = {name: [] for name in OUTPUTS}
        for t in range(T):
            if t % self.every == 0:
                self._checkpoints.append(sim.get_state())
            sim.step(ctrl[t], nstep=nstep)
            for name in STATE:
                states[name].append(np.array(getattr(sim, name), np.float64))
            if sensors:
                states["sensors"].append(np.array(sim.sensordata_ideal, np.float64))
        self.qpos, self.qvel, self.act = (np.stack(states[name]) for name in STATE)
        self.sensors = np.stack(states["sensors"]) if sensors else None

    @property
    def memory(self) -> int:
        """Upper bound of the memory of `vjp` in bytes: checkpoints, the states between two checkpoints, and the matrices of one control.

        It does not include the copies that are stepped for finite differences, at most `stepper.derivatives.copies.COPIES_PER_THREAD` per
        thread; these are kept for the next linearization. With `smoothing`, multiply the matrices by the number of samples.
        """
        model, n = self._plant.model, self._plant.num_envs or 1
        state = self._checkpoints[0].nbytes
        size = 2 * model.nv + model.na
        parameters = sum(np.size(getattr(model, parse(name).field)) for name in self._parameters)
        matrices = 8 * n * (size + (model.nsensordata if self._sensors else 0)) * (size + model.nu + parameters)
        return state * (len(self._checkpoints) + min(self.every, len(self._ctrl))) + matrices

    def vjp(
        self,
        *,
        qpos: ArrayLike | None = None,
        qvel: ArrayLike | None = None,
        act: ArrayLike | None = None,
        sensors: ArrayLike | None = None,
        smoothing: Smoothing | None = None,
        undetermined: Literal["raise", "zero"] = "raise",
        **settings: Any,
    ) -> Gradients:
        """Returns the vector-Jacobian product: gradients of a scalar function by the controls, the initial state and parameters.

        The checkpoints are processed in reverse order. The states between two checkpoints are recomputed. Then, for each control in reverse
        order, its steps are linearized and the gradient is propagated to the state before them.

        Args:
            qpos: Gradient of the function with respect to `self.qpos`, (T, num_envs, nq); None means zero.
            qvel: Gradient with respect to `self.qvel`, (T, num_envs, nv); None means zero.
            act: Gradient with respect to `self.act`, (T, num_envs, na); None means zero.
            sensors: Gradient with respect to `self.sensors`, (T, num_envs, nsensordata); None means zero.
            smoothing: Settings for derivatives that are averaged over random displacements, for gradients across kinks. None uses the
                derivatives of the actual steps.
            undetermined: Treatment of steps without a derivative, at some kinks (docs/how-to/derivatives.md). "raise" raises an error.
                With "zero", the gradients of the environment are 0, and its flag in `Gradients.undetermined` is set.
            **settings: `step`, `tolerance`, `centered`, `extrapolate` and `method` of `linearize`.

        Raises:
            UndeterminedDerivative: A step has no derivative. The error has the environment, the control and the coordinate.
            ValueError: A wrong shape, a number that is not finite, or `sensors` for a rollout without `sensors=True`.
            TypeError: `smoothing` is not a `Smoothing`.
        """
        if smoothing is not None and not isinstance(smoothing, Smoothing):
            raise TypeError(f"smoothing is {type(smoothing).__name__}, must be a stepper.derivatives.Smoothing or None")
        if undetermined not in ("raise", "zero"):
            raise ValueError(f"undetermined is {undetermined!r}, must be 'raise' or 'zero'")
        given = {"qpos": qpos, "qvel": qvel, "act": act, "sensors": sensors}
        cotangents = {name: self._cotangent(name, value) for name, value in given.items()}
        model, T, n = self._plant.model, len(self._ctrl), self._plant.num_envs or 1
        adjoint = np.zeros((n, 2 * model.nv + model.na))
        controls, kinked = np.zeros((T, n, model.nu)), np.zeros((T, n), dtype=bool)
        parameters: dict[str, Array] = {}
        lost = np.zeros(n, dtype=bool)
        wrt = (*STATE, "ctrl", *self._parameters)
        for first in reversed(range(0, T, self.every)):
            segment = range(first, min(first + self.every, T))
            for t, state in zip(reversed(segment), reversed(self._states(segment)), strict=True):
                adjoint += self._direct(cotangents, t)
                self._plant.set_state(state)
                arguments: dict[str, Any] = {"ctrl": self._ctrl[t], "nstep": self._nstep, "sensors": cotangents["sensors"] is not None}
                if smoothing is None:
                    part = linearize(self._plant, wrt, **arguments, **settings)
                else:
                    part = smoothed(self._plant, smoothing, wrt, draw=t, **arguments, **settings)
                reading = None if cotangents["sensors"] is None else cotangents["sensors"][t]
                needed = np.any(adjoint if reading is None else np.concatenate([adjoint, reading], axis=1), axis=1)
                for env, error in first_undetermined(part, needed, t, model).items():
                    if undetermined == "raise":
                        raise error
                    lost[env] = True
                controls[t] = self._pull(part, "ctrl", adjoint, reading)
                for name in self._parameters:
                    parameters[name] = parameters.get(name, 0.0) + self._pull(part, name, adjoint, reading)
                kinked[t] = np.asarray(part.near_kink).reshape(n)
                adjoint = np.concatenate([self._pull(part, name, adjoint, reading) for name in STATE], axis=1)
        adjoint[lost], controls[:, lost] = 0.0, 0.0
        for gradient in parameters.values():
            gradient[lost] = 0.0
        return self._gradients(adjoint, controls, parameters, kinked, lost)

    def _cotangent(self, name: str, given: ArrayLike | None) -> Array | None:
        """Checked copy of an argument of `vjp`, (T, num_envs, ...): the gradient with respect to an attribute; None if not given."""
        if given is None:
            return None
        states = getattr(self, name)
        if states is None:
            raise ValueError("gradients by sensors need rollout(..., sensors=True)")
        array = array_of(f"the gradient by {name}", given)
        if array.shape != states.shape:
            raise ValueError(f"the gradient by {name} has shape {array.shape}, must be {states.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"the gradient by {name} has a number that is not finite, at control {np.argwhere(~np.isfinite(array))[0][0]}")
        return array[:, None] if self._plant.num_envs is None else array

    def _direct(self, cotangents: dict[str, Array | None], t: int) -> Array:
        """Partial gradient of the scalar function of `vjp` with respect to the state after control t, (num_envs, 2 nv + na).

        The state is in tangent coordinates. The gradient does not include the effect of this state on later states.
        """
        model, n = self._plant.model, self._plant.num_envs or 1
        after = self.qpos[t].reshape(n, -1)
        numbers = cotangents["qpos"]
        parts = [np.zeros((n, model.nv)) if numbers is None else to_tangent(model, after, numbers[t])]
        for name, size in (("qvel", model.nv), ("act", model.na)):
            own = cotangents[name]
            parts.append(np.zeros((n, size)) if own is None else own[t])
        return np.concatenate(parts, axis=1)

    def _states(self, segment: range) -> list[State]:
        """States before each control of a segment (the controls between two checkpoints), recomputed from the segment's checkpoint."""
        self._plant.set_state(self._checkpoints[segment.start // self.every])
        states = []
        for t in segment:
            states.append(self._plant.get_state())
            if t + 1 < segment.stop:
                self._plant.step(self._ctrl[t], nstep=self._nstep)
        return states

    def _pull(self, part: Linearization, name: str, adjoint: Array, reading: Array | None) -> Array:
        """Gradient with respect to one input of the steps in which one control is held, by the chain rule: (num_envs, *columns).

        The input is a part of the state before the steps, the control, or a parameter of the model. `columns` is its shape.

        Args:
            part: Linearization of these steps.
            name: Name of the input: "qpos", "qvel", "act", "ctrl" or the name of a parameter.
            adjoint: Gradient with respect to the state after the steps, (num_envs, n).
            reading: Gradient with respect to the sensor readings after the steps, (num_envs, nsensordata); None means zero.
        """
        n = len(adjoint)
        block = part.blocks[name].reshape(n, adjoint.shape[1], *np.shape(part.blocks[name])[1 + (self._plant.num_envs is not None) :])
        out: Array = np.einsum("er,er...->e...", adjoint, block)
        if reading is not None:
            own = part.sensors[name]
            out = out + np.einsum("er,er...->e...", reading, own.reshape(n, reading.shape[1], *block.shape[2:]))
        return out

    def _gradients(self, adjoint: Array, controls: Array, parameters: dict[str, Array], kinked: Bools, lost: Bools) -> Gradients:
        """Result of `vjp` from gradients in tangent coordinates. The axis of environments is left out if `num_envs` is None.

        Args:
            adjoint: Gradient with respect to the initial state, (num_envs, 2 nv + na), in tangent coordinates.
            controls: Gradient with respect to the controls, (T, num_envs, nu).
            parameters: Gradients with respect to parameters, (num_envs, ...), by name.
            kinked: Whether the steps with each control are near a kink, (T, num_envs).
            lost: Whether an environment has a step without a derivative, (num_envs,).
        """
        model = self._plant.model
        single = self._plant.num_envs is None
        nv = model.nv
        numbers = from_tangent(model, self._start["qpos"], adjoint[:, :nv])
        qpos, qvel, act = (part[0] if single else part for part in (numbers, adjoint[:, nv : 2 * nv], adjoint[:, 2 * nv :]))
        return Gradients(
            qpos=qpos,
            qvel=qvel,
            act=act,
            ctrl=controls[:, 0] if single else controls,
            parameters={name: value[0] if single else value for name, value in parameters.items()},
            near_kink=kinked[:, 0] if single else kinked,
            undetermined=lost[0] if single else lost,
        )


def rollout(
    sim: Stepper,
    ctrl: ArrayLike,
    nstep: int = 1,
    *,
    parameters: Sequence[str] = (),
    every: int | None = None,
    sensors: bool = False,
) -> Rollout:
    """Steps a copy of a stepper `nstep` times with each of T controls, and stores checkpoints for derivatives.

    Args:
        sim: Stepper with the initial state. It does not change.
        ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
        nstep: Number of steps for which each control is held.
        parameters: Names of parameters with respect to which `vjp` computes gradients, in the format of `wrt` of `linearize`.
        every: Number of controls between two checkpoints; None uses the square root of T, which takes the least memory. `vjp` repeats the
            steps of each control once.
        sensors: Whether to compute readings of ideal sensors.

    Raises:
        TypeError: `parameters` is a string, or an entry is not a string. Or `nstep` or `every` is no whole number.
        ValueError: A wrong shape, a number of steps below 1, or a parameter that is unknown, given twice, or a part of
            the state or the controls. Also an actuator with a memory: a delay, a lag, a sampled servo or an integral.
    """
    check_kind("sim", sim, Stepper, "stepper.Stepper(model, num_envs)")
    if names := sim._actuators_with_memory():
        raise ValueError(
            f"actuators {', '.join(names)} have a delay, a lag, a sampled servo or an integral: gradients of a rollout do not contain the "
            "effect of a control on later steps through them; use actuators without them, or finite differences of Stepper.rollout"
        )
    model, n = sim.model, sim.num_envs
    check_parameters(model, parameters)
    given = array_of("ctrl", ctrl)
    if given.ndim == 2 and n is not None and given.shape[1] == model.nu:
        given = np.broadcast_to(given[:, None], (len(given), n, model.nu))
    shape = (model.nu,) if n is None else (n, model.nu)
    if given.ndim != 1 + len(shape) or given.shape[1:] != shape or not len(given):
        must = "(T, nu)" if n is None else "(T, num_envs, nu) or (T, nu)"
        raise ValueError(f"ctrl has shape {given.shape}, must be {must} with nu = {model.nu}" + (f" and num_envs = {n}" if n else ""))
    if not np.isfinite(given).all():
        raise ValueError("ctrl has a number that is not finite")
    check_whole("nstep", nstep, least=1)
    if every is not None:
        check_whole("every", every, least=1)
    check_flag("sensors", sensors)
    return Rollout(copy.deepcopy(sim), np.array(given), int(nstep), parameters=parameters, every=every, sensors=sensors)
