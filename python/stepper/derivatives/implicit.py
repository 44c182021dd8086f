"""Derivatives by the implicit function theorem at the solution of a step: one linear solve instead of a step per perturbed number.

The mode of the step is fixed: contacts that push, stick and slip, and joints at a limit or held by dry friction. Derivatives of the
impulses with respect to all columns (perturbed numbers) solve one linear system. Forces, inertia and geometry are differentiated by finite
differences with fixed impulses (`Stepper._differentiate`). docs/development/decisions/implicit_derivatives.md has the formulas and their
limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Stepper
from stepper.derivatives.copies import Nominal, replicas_of, rows
from stepper.derivatives.kinks import Kink
from stepper.derivatives.perturbations import ROUNDING, STATE, Array, Block, Stencil, blocks_of, stencil_of
from stepper.shared.fields import RANDOMIZED

STEP = 2.0**-20
"""Half width of the finite differences of forces, inertia and geometry, for coordinates of order 1 (SI units).

Active constraints and impulses are fixed, so that the differences have no error of the solver. The remaining errors are given relative to
the largest entry of a column. Rounding causes 1e-9. Third derivatives of MuJoCo's friction cones caused at most 1e-7 in tests.
"""


def check(sim: Stepper, blocks: Sequence[Block], *, extrapolate: bool, sensors: bool) -> None:
    """Checks the arguments of `linearize(method="implicit")`. `Stepper._differentiate` raises errors for unsupported options.

    Raises:
        ValueError: An argument is only supported by `method="fd"`.
    """
    remedy = "use method='fd'"
    parameters = [block.name for block in blocks if block.field in RANDOMIZED]
    if parameters:
        raise ValueError(f"wrt has the parameters {', '.join(parameters)}, which have no implicit derivatives: {remedy}")
    if sensors:
        raise ValueError(f"sensors=True: there are no implicit derivatives of sensors: {remedy}")
    if extrapolate:
        raise ValueError("extrapolate=True is for method='fd': implicit derivatives have no differences of solved steps to extrapolate")
    if sim.actuators is not None:
        raise ValueError(f"the stepper has actuators=, whose memory has no implicit derivatives: {remedy}")


def where_available(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], *, nstep: int, tolerance: float, sensors: bool
) -> dict[str, NDArray[Any]] | None:
    """Derivatives of the step by the implicit function theorem, in all environments.

    The result is None if the theorem does not support the options or sensors, or if all `blocks` are parameters.

    Args:
        sim: The stepper.
        nominal: State of its environments.
        blocks: Quantities with respect to which the step is differentiated. Columns of parameters are 0 and have the flag `Kink.UNSOLVED`.
        nstep: Number of steps.
        tolerance: Residual to which steps are solved, m/s.
        sensors: Whether derivatives of sensor readings are needed, which the theorem does not support.

    Returns:
        Arrays by name, as `derivatives` returns them.
    """
    state = [block for block in blocks if block.field not in RANDOMIZED]
    if not state:
        return None
    stencil = stencil_of(sim.model, state, nominal.fields, step=STEP, levels=1, centered=True)
    try:
        check(sim, state, extrapolate=False, sensors=sensors)
        found = derivatives(sim, nominal, state, stencil, nstep=nstep, tolerance=tolerance)
    except ValueError:
        return None
    chosen = np.concatenate([np.full(block.count, block.field not in RANDOMIZED) for block in blocks])
    n, _, _, size = found["slopes"].shape
    slopes, causes = np.zeros((n, 1, len(chosen), size)), np.full((n, len(chosen)), np.uint32(Kink.UNSOLVED))
    slopes[:, :, chosen], causes[:, chosen] = found["slopes"], found["causes"]
    return found | {"slopes": slopes, "causes": causes}


def derivatives(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], stencil: Stencil, *, nstep: int, tolerance: float
) -> dict[str, NDArray[Any]]:
    """Derivatives of the state after `nstep` steps in all environments, by the implicit function theorem.

    Args:
        sim: The stepper.
        nominal: State of its environments.
        blocks: Quantities with respect to which the state is differentiated.
        stencil: Displacements for the finite differences of forces, inertia and geometry.
        nstep: Number of steps.
        tolerance: Residual to which steps are solved, m/s.

    Returns:
        Arrays by name: "slopes" (num_envs, 1, columns, rows), the derivatives; "causes" (num_envs, columns), flags of `Kink`; and the other
        arrays that `stepper.derivatives.linearize` computes by finite differences. The mask "implicit", (num_envs,), is False for
        environments without valid derivatives: the theorem does not apply, or the step was not solved.
    """
    if nstep > 1:
        return _product(sim, nominal, blocks, float(stencil.step.max(initial=0.0)), nstep=nstep, tolerance=tolerance)
    fits = sim.precision == "f64" and sim.num_envs is not None
    plant = sim if fits else replicas_of(sim, nominal, 1, tolerance=tolerance)
    one = plant._differentiate(nominal.fields["ctrl"], [block.field for block in blocks], stencil.offsets[:, 0], tolerance)
    return _combined(one, one["slopes"], one["causes"], [one], stencil.step[:, 0])


def _product(
    sim: Stepper, nominal: Nominal, blocks: Sequence[Block], width: float, *, nstep: int, tolerance: float
) -> dict[str, NDArray[Any]]:
    """Derivatives of the state after several steps, as `derivatives` returns them: the product of those of the single steps."""
    model, ctrl = sim.model, nominal.fields["ctrl"]
    plant = replicas_of(sim, nominal, 1, tolerance=tolerance)
    whole = blocks_of(model, (*STATE, "ctrl"))
    size, columns = 2 * model.nv + model.na, sum(block.count for block in blocks)
    first_row = {"qpos": 0, "qvel": model.nv, "act": 2 * model.nv}
    slopes, held, place = np.zeros((nominal.num_envs, size, columns)), slice(0, 0), 0
    for block in blocks:
        own = slice(place, place + block.count)
        if block.field == "ctrl":
            held = own
        else:
            slopes[:, first_row[block.field] : first_row[block.field] + block.count, own] = np.eye(block.count)
        place += block.count
    steps = []
    for _ in range(nstep):
        now = {name: rows(plant, name) for name in STATE} | {"ctrl": ctrl}
        stencil = stencil_of(model, whole, now, step=width, levels=1, centered=True)
        one = plant._differentiate(ctrl, [block.field for block in whole], stencil.offsets[:, 0], tolerance)
        slopes = one["slopes"][..., :size] @ slopes
        slopes[..., held] += one["slopes"][..., size : size + held.stop - held.start]
        steps.append(one)
        plant.step(ctrl)
    # A kink in any step affects every column of the product.
    causes = np.bitwise_or.reduce([np.bitwise_or.reduce(one["causes"], axis=1) for one in steps], axis=0)
    return _combined(steps[-1], slopes, np.repeat(causes[:, None], columns, axis=1), steps, np.full((nominal.num_envs, columns), width))


def _combined(
    last: dict[str, NDArray[Any]], slopes: Array, causes: NDArray[np.uint32], steps: list[dict[str, NDArray[Any]]], width: Array
) -> dict[str, NDArray[Any]]:
    """Arrays for a `Linearization`, by name: derivatives "slopes" (num_envs, 1, columns, rows), kink flags, residuals and the end state.

    Args:
        last: Result of `Stepper._differentiate` for the last step.
        slopes: Derivatives over all steps, (num_envs, rows, columns).
        causes: Flags of `Kink` over all steps, (num_envs, columns).
        steps: Results of `Stepper._differentiate` for every step.
        width: Half widths of the differences, (num_envs, columns).
    """
    size = np.maximum(np.abs(last["qvel"]).max(axis=1, initial=0.0), 1.0)
    return {
        "slopes": np.moveaxis(slopes, 2, 1)[:, None],
        "width": width,
        "noise": last["residual"] + ROUNDING * size,
        "causes": causes,
        "kinked_steps": np.stack([(one["causes"] != 0).any(axis=1) for one in steps], axis=1),
        "kink_distance": np.min([one["distance"] for one in steps], axis=0),
        "residual": last["residual"],
        "status": np.bitwise_or.reduce([one["status"] for one in steps], axis=0),
        "implicit": np.logical_and.reduce([one["sound"] != 0 for one in steps], axis=0),
        **{name: last[name] for name in STATE},
    }
