"""`Stepper.linearize`: a method in Python, as the binary has none. What it does is imported when it is called."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from numpy.typing import ArrayLike

from stepper._stepper import Stepper

if TYPE_CHECKING:
    from stepper.derivatives import Linearization


def linearize(  # noqa: D417 - self is the stepper
    self: Stepper,
    wrt: Sequence[str] = ("qpos", "qvel", "act", "ctrl"),
    *,
    ctrl: ArrayLike | None = None,
    nstep: int = 1,
    method: Literal["fd", "implicit"] = "fd",
    step: float | None = None,
    tolerance: float | None = None,
    extrapolate: bool = False,
    sensors: bool = False,
) -> Linearization:
    """Derivatives of the state after `nstep` steps by the state, controls and parameters now, in all environments; advances nothing.

    Every column is a central difference between two perturbed copies of an environment. Copies of all environments and columns are
    stepped together, in lanes and on the stepper's threads, with its options and all that environments have of their own, but to a
    tighter tolerance; the stepper is only read. With contact the step is smooth only between kinks: see `Linearization.near_kink`
    and docs/derivatives.md.

    Args:
        wrt: "qpos", "qvel", "act", "ctrl", and fields of `Stepper.randomize`, whole ("body_mass") or of some elements
            ("geom_friction:floor,box"; of the fields of degrees of freedom the joints'). Columns are zero where a mass, size, stiffness
            or frictionloss of 0 says that the model has none.
        ctrl: Controls held during the steps, (num_envs, nu) or (nu,); None is those in force.
        nstep: Number of steps.
        method: "fd", finite differences.
        step: Half width of the differences, for coordinates in SI units and for parameters relative to their size; None is the one
            that the tolerance asks for (`stepper.derivatives.perturbations.step_of`).
        tolerance: Residual to which copies are solved, m/s; None is 1e-13, or the stepper's own if that is less.
        extrapolate: Whether differences of twice the width are taken too, and Richardson's extrapolation of both, which costs twice
            the copies and estimates errors.
        sensors: Whether to give derivatives of the ideal sensors' readings too.

    Raises:
        ValueError: An unknown name, a wrong shape, a step or number of steps that is none.
        ModelError: A parameter that cannot be perturbed, with its element.
        NotImplementedError: `method="implicit"`.
    """
    made: Linearization = importlib.import_module("stepper.derivatives").linearize(
        self, wrt, ctrl=ctrl, nstep=nstep, method=method, step=step, tolerance=tolerance, extrapolate=extrapolate, sensors=sensors
    )
    return made


Stepper.linearize = linearize  # type: ignore[method-assign]
