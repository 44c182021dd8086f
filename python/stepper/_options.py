"""Numerical settings of a simulation step (class `Options`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from stepper._stepper import Model, check_options

Precision: TypeAlias = Literal["f64", "f32"]
"""Floating-point type in which the step computes, "f64" (double precision) or "f32" (single precision)."""
_PRECISIONS: dict[str, Precision] = {"float64": "f64", "float32": "f32"}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Numerical methods and tolerances of a step. Immutable: `dataclasses.replace` makes a changed copy.

    Values out of range raise `ValueError`, and values of another type `TypeError`.

    Attributes:
        timestep: Time step, s; None uses the time step of the model.
        contact: Law of constraint forces, for contacts, limits, dry friction and equalities.

            * "hard": rigid, Signorini's condition and Coulomb's cone, each step solved to the tolerance.
            * "mujoco": MuJoCo's soft contact as its documentation defines it (computation chapter), from the model's solref, solimp,
              solmix, margins, impratio and cone. Newton's method solves the convex problem, in at most `iterations` steps. The residual is
              the velocity in m/s that the remaining imbalance of forces causes in a step. `solver`, `stabilization` and restitution have
              no effect. docs/explanation/mujoco_law.md lists what agrees with MuJoCo, and how closely.
        integrator: Time integrator. None selects "midpoint" with hard contact. With contact="mujoco", None selects the integrator of the
            model's source, or "euler" for models without a source.

            * "midpoint": Moreau's rule, second order in smooth motion. Springs, dampers and servos follow the implicit midpoint rule. It is
              stable for any stiffness and keeps the energy of linear springs. Oscillations much faster than the time step decay slowly. A
              single body, free or on a ball joint, keeps its angular momentum exactly (with `error`, to the estimate) and its energy
              without drift.
            * "implicit": backward Euler for springs, dampers and servos, first order. Velocity-dependent forces use the predicted
              velocity. It is stable for any stiffness, and damps oscillations much faster than the time step within one step.
            * "euler": semi-implicit, first order, MuJoCo's Euler: implicit in joint damping alone. Springs and servos need
              h^2 k / m < 4 (time step h, stiffness k, mass m), and a tumbling body gains energy.
            * "rk4": Runge-Kutta-Munthe-Kaas of order 4 for environments without an active constraint (contact, limit, dry friction) in
              this step. Other environments take a midpoint step, which has errors of momentum and energy. The Runge-Kutta step is explicit:
              springs need h sqrt(k / m) < 2.8, and dampers with coefficient d need h d / m < 2.7.

            With contact="mujoco" the integrators are those of MuJoCo, except "discrete": "euler", "implicitfast", "implicit" and "rk4".
            Joint damping is implicit in "euler", unless the model disables that. In "rk4", the constraints are solved in each of the four
            stages.

            With "midpoint" and "implicit", a servo at its force limit exerts that limit and adds no stiffness. Fixed tendons whose
            joints lie on several branches get an added inertia that grows with h^2 k and h d, which keeps them stable.
        error: Error of the positions that a step may make, m and rad; None makes every step once, whatever its error.

            Otherwise a step is divided into substeps, which differ between environments. The estimate is that of step doubling: every
            interval is stepped as a whole and in halves, and smooth motion gets the extrapolation of both. An interval may have a share of
            the error in proportion to its length, but at least a quarter. INACCURATE in `status` means that their sum,
            `Stepper.error_estimate`, exceeds the error, as in some steps with several impacts. `Stepper.substeps` counts substeps, of which
            the shortest are 1/256 of the time step. Controls, actuator and sensor models act once in a step. The option needs hard contact
            and "midpoint", "implicit" or "euler". `linearize` refuses it. docs/how-to/keep_an_error.md has its costs.
        solver: Solver of the constraint problem with hard contact.

            * "pgs": projected Gauss-Seidel with Anderson acceleration. Each iteration (sweep) visits all constraints, and solves the
              Coulomb problem of each contact exactly.
            * "newton": proximal Newton steps for every environment that the first two sweeps do not solve.
            * "auto": sweeps, then Newton for environments whose residual is still above the tolerance.
        iterations: Largest number of sweeps ("auto" makes no more than 50). The number also bounds the Newton steps of each island of
            bodies in contact (docs/development/decisions/bounds.md). A step that reaches the bound sets NOT_CONVERGED in `status`, and
            `Stepper.worst_row` names the constraint with the largest residual. `Stepper.iterations` counts sweeps and Newton steps,
            `Stepper.newton_steps` Newton steps alone.
        tolerance: Largest residual at which the solver stops, m/s. The residual is the error of the contact conditions, expressed as a
            velocity (natural map). None uses 0.6 % of the velocity that gravity adds in a step, from 1e-6 to 1e-4. The relative
            error of contact forces then does not grow with shorter steps. Hard contact with precision="f32" uses 1e-4. In both
            precisions, it is at most 0.006 rad/s times the radius of gyration of the smallest free body, but at least 1e-6. The setting
            contact="mujoco" with "f64" uses 1e-6.
        rtol: Factor of the speed of the environment's fastest degree of freedom before the step (its number in rad/s or m/s). The
            solver stops at the smaller of `rtol` times this speed and `tolerance`, so that environments at rest do not creep. With
            precision="f32", rounding limits this to environments in which a free body has three contacts with another. A large
            number, such as 1e9, switches it off. It has no effect with contact="mujoco". NOT_CONVERGED compares with `tolerance`.
        stabilization: Method that removes overlap and other position errors of constraints: "baumgarte" (a velocity bias), "split" (a
            second solve that moves positions only) or "none".
        baumgarte: Fraction of the overlap beyond the slop that is removed per step, 0 to 1.
        slop: Overlap that is not corrected, m (rad for hinge limits).
        max_correction_speed: Fastest correction of overlap, m/s.
        restitution_threshold: Approach speed below which a touching contact rests instead of bouncing, m/s.
        max_contacts: Largest number of contacts of one environment; None uses the default of the model. Further contacts are left out, and
            `status` has CONTACTS_FULL.
    """

    timestep: float | None = None
    contact: Literal["hard", "mujoco"] = "hard"
    integrator: Literal["euler", "midpoint", "implicit", "implicitfast", "rk4"] | None = None
    error: float | None = None
    solver: Literal["auto", "pgs", "newton"] = "auto"
    iterations: int = 50
    tolerance: float | None = None
    rtol: float = 1e-3
    stabilization: Literal["baumgarte", "split", "none"] = "split"
    baumgarte: float = 0.2
    slop: float = 1e-5
    max_correction_speed: float = 1.0
    restitution_threshold: float = 0.01
    max_contacts: int | None = None

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def from_model(cls, model: Model) -> Options:
        """Returns options that reproduce the model's source in MuJoCo: `contact="mujoco"` and the source's integrator.

        Softness, cone, impratio and noslip iterations come from the model itself, as does the time step. `iterations` is at least that of
        the source. Newton's method solves every step to `tolerance`, in m/s, whatever solver and tolerance the source has.

        Args:
            model: Model. If it was built in code, without a source, the result is `Options()`.

        Raises:
            TypeError: `model` is not a `stepper.Model`.
            ValueError: The source has an integrator that stepper does not have.
        """
        requested = getattr(model, "_requested_options", None)
        if requested is None:
            raise TypeError(f"Options.from_model takes a stepper.Model, not {type(model).__name__}; stepper.load(path) reads one")
        return cls(**requested())


def precision_of(value: Any) -> Precision:
    """Precision from "f64" or "f32", or from a floating-point type of NumPy or its name: `np.float32`, `np.dtype("f4")`, "float32"."""
    if isinstance(value, str) and value in _PRECISIONS.values():
        return value  # type: ignore[return-value]
    if isinstance(value, str | np.dtype | type):
        try:
            found = _PRECISIONS.get(np.dtype(value).name)
        except TypeError:
            found = None
        if found is not None:
            return found
    raise ValueError(f'precision is {value!r}, must be "f64" or "f32", or np.float64 or np.float32')
