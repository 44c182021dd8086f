"""Randomised smoothing: means of derivatives over random displacements of the state and the controls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from stepper._stepper import Stepper
from stepper.derivatives.copies import nominal_of, replicas_of
from stepper.derivatives.kinks import Kink
from stepper.derivatives.linearize import Linearization, linearize
from stepper.derivatives.perturbations import Array


@dataclass(frozen=True)
class Smoothing:
    """Settings of randomised smoothing, for `Rollout.vjp(smoothing=...)`.

    The derivative of a step is averaged over normally distributed displacements of the state and the controls. Where the step is
    continuous, this is the derivative of the averaged step (Suh, Pang & Tedrake 2022, "Bundled gradients through contact via randomized
    smoothing"). The gradient then includes contacts that are nearly closed, and has no jumps at kinks. The rollout itself does not change.

    Attributes:
        samples: Number of displacements per environment. It is even, because displacements are drawn in pairs of opposite sign.
        qpos: Standard deviation of displacements of qpos, m and rad.
        qvel: Standard deviation of displacements of qvel, m/s and rad/s.
        act: Standard deviation of displacements of act, in its unit.
        ctrl: Standard deviation of displacements of the controls, in their units.
        seed: Seed of the random numbers; each step of a rollout draws new ones.

    Raises:
        ValueError: `samples` is odd or below 2, a standard deviation is negative, all are 0, or `seed` is negative.
    """

    samples: int = 16
    qpos: float = 0.0
    qvel: float = 0.0
    act: float = 0.0
    ctrl: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not isinstance(self.samples, int | np.integer) or self.samples < 2 or self.samples % 2:
            raise ValueError(f"samples is {self.samples!r}, must be an even number, at least 2")
        if not isinstance(self.seed, int | np.integer) or self.seed < 0:
            raise ValueError(f"seed is {self.seed!r}, must be a whole number, 0 or above")
        spreads = {field.name: getattr(self, field.name) for field in fields(self) if field.name in ("qpos", "qvel", "act", "ctrl")}
        for name, spread in spreads.items():
            if not isinstance(spread, int | float | np.number) or not 0.0 <= spread < math.inf:
                raise ValueError(f"{name} is {spread!r}, must be a standard deviation, 0 or above")
        if not any(spreads.values()):
            raise ValueError("all standard deviations are 0: set one of qpos, qvel, act or ctrl above 0")


def smoothed(
    sim: Stepper, smoothing: Smoothing, wrt: Sequence[str], *, ctrl: Array, draw: int, sensors: bool, **settings: Any
) -> Linearization:
    """Linearization of the steps, averaged over random displacements of the state and the controls.

    Args:
        sim: The stepper; it does not change.
        smoothing: Number and size of the displacements.
        wrt: Names of the quantities with respect to which the steps are differentiated, as in `linearize`.
        ctrl: Controls, (num_envs, nu) or (nu,).
        draw: Number that selects the random displacements, together with the seed.
        sensors: Whether to differentiate readings of ideal sensors.
        **settings: Other arguments of `linearize`.

    Returns:
        Linearization whose derivatives are means over the displacements (samples) at which the steps have a derivative. It has the kink
        flags of all samples, but `Kink.UNDETERMINED` only in columns for which no sample has a derivative. The kink distance is the
        smallest of any sample. `errors` is empty, and the state is that of the first sample.
    """
    nominal, model, count = nominal_of(sim, ctrl, ()), sim.model, smoothing.samples
    n, half = nominal.num_envs, smoothing.samples // 2

    def displaced(name: str, size: int) -> Array:
        # Drawn per field, in the order of the environments: an environment's displacements do not depend on the number of environments.
        rng = np.random.default_rng((smoothing.seed, draw, list(nominal.fields).index(name)))
        one = getattr(smoothing, name) * rng.normal(size=(n, half, size))
        return np.stack([one, -one], axis=2).reshape(n * count, size)

    flat = {name: np.repeat(value, count, axis=0) for name, value in nominal.fields.items()}
    flat["qpos"] = model.integrate_pos(flat["qpos"], displaced("qpos", model.nv))
    for name in ("qvel", "act", "ctrl"):
        flat[name] = flat[name] + displaced(name, flat[name].shape[1])
    points = replicas_of(sim, nominal, count)
    points.set_state(flat["qpos"], flat["qvel"], act=flat["act"], keep_warmstart=True)
    lin = linearize(points, wrt, ctrl=flat["ctrl"], sensors=sensors, **settings)
    single = sim.num_envs is None

    def by_env(array: Any, reduce: Any) -> Any:
        reduced = reduce(array.reshape(n, count, *array.shape[1:]), axis=1)
        return reduced[0] if single else reduced

    def first(array: Any, axis: int) -> Any:
        return array.take(0, axis=axis)

    def determined(name: str) -> Any:
        return (lin.kinks[name] & np.uint32(Kink.UNDETERMINED)) == 0

    def mean(name: str, block: Any) -> Any:
        # Mean over the samples that have the derivative; it is 0 in the others.
        valid = determined(name).reshape(n, count, 1, *block.shape[2:]).sum(axis=1)
        means = block.reshape(n, count, *block.shape[1:]).sum(axis=1) / np.maximum(valid, 1)
        return means[0] if single else means

    def flags_of(name: str, flags: Any) -> Any:
        some = by_env(determined(name), np.any)
        together = by_env(flags, np.bitwise_or.reduce)
        return np.where(some, together & ~np.uint32(Kink.UNDETERMINED), together)

    return replace(
        lin,
        blocks={name: mean(name, block) for name, block in lin.blocks.items()},
        sensors={name: mean(name, block) for name, block in lin.sensors.items()},
        errors={},
        kinks={name: flags_of(name, flags) for name, flags in lin.kinks.items()},
        near_kink=by_env(lin.near_kink, np.any),
        kinked_steps=by_env(lin.kinked_steps, np.any),
        kink_distance=by_env(lin.kink_distance, np.min),
        residual=by_env(lin.residual, np.max),
        status=by_env(lin.status, np.bitwise_or.reduce),
        **{name: by_env(getattr(lin, name), first) for name in ("qpos", "qvel", "act")},
    )
