"""Settings of a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from stepper._hints import Hinting

Precision: TypeAlias = Literal["f64", "f32"]
"""Scalar type of the lanes."""

if TYPE_CHECKING:
    from stepper._stepper import Model


@dataclass(frozen=True, kw_only=True)
class Options(metaclass=Hinting):
    """Every choice of method that a step makes. Immutable; `dataclasses.replace` makes another.

    Out-of-range values raise `ValueError` when a `Stepper` is made with them.

    Attributes:
        timestep: Time step in s; None takes the model's own.
        contact: Law of contacts, limits, dry friction and equalities.

            * "hard": rigid, Signorini's condition and Coulomb's cone, each step solved to the tolerance.
            * "mujoco": MuJoCo's soft law as its documentation defines it (computation chapter), from the model's solref, solimp, solmix,
              margins, impratio and cone. The convex problem is solved by Newton's method; `iterations` bounds its steps, and its residual
              is the velocity in m/s that the remaining imbalance of forces makes in a step. Solver, stabilisation
              and restitution have no part in it. docs/explanation/mujoco_law.md has what agrees with MuJoCo, and how far.
        integrator: How velocities and positions advance. None is "midpoint" with hard contact, and with contact="mujoco" what the model's
            source asks for, or "euler".

            * "midpoint": Moreau's rule, second order in smooth motion. Springs, dampers and servos follow the implicit midpoint rule,
              stable for any stiffness, which keeps the energy of linear springs. What is much faster than a step rings and decays slowly. A
              single body, free or on a ball joint, keeps its angular momentum exactly and its energy without drift.
            * "implicit": first order. Springs, dampers and servos by backward Euler, velocity-dependent forces at the velocity to be
              expected: stable for any stiffness, and what is much faster than a step is gone after it.
            * "euler": semi-implicit, first order, and what MuJoCo calls Euler: implicit in joint damping alone. Springs and servos need
              h^2 k / m < 4, and a tumbling body gains energy.
            * "rk4": Runge-Kutta-Munthe-Kaas of order 4 for environments without an active constraint (contact, limit, dry friction) in
              this step; the others take a midpoint step, with its errors of momentum and energy. Its smooth step is explicit in everything,
              so that springs and dampers need h sqrt(k / m) < 2.8 and h d / m < 2.7.

            With contact="mujoco" there are MuJoCo's own: "euler" (with the joints' damping implicit, unless the model says otherwise),
            "implicitfast", "implicit", "discrete", which takes springs, dampers, servos and constraints together at the end of the step,
            and "rk4", whose four stages each solve the constraints.

            With "midpoint" and "implicit" a servo at a bound of its force gives the bound, and none of its stiffness. Fixed tendons whose
            joints lie on several branches act with an inertia that grows with h^2 k and h d, which keeps them stable too.
        solver: "pgs" (projected Gauss-Seidel that solves every contact's own Coulomb problem exactly, with Anderson's acceleration),
            "newton" (augmented-Lagrangian Newton for every environment that the first two sweeps do not solve), or "auto": sweeps, then
            Newton for the environments that they leave above the tolerance.
        iterations: Sweeps of the solver at the most ("auto" makes no more than 50), and Newton steps at the most for each island of bodies
            in contact and pass (docs/development/decisions/bounds.md). A step that runs out of them says NOT_CONVERGED in its status, and
            `Stepper.worst_row` names the row. `Stepper.iterations` counts both, `Stepper.newton_steps` Newton steps alone.
        tolerance: Natural-map residual at which the solver stops, in m/s; None is 1e-6, and 1e-4 with precision="f32". With
            contact="mujoco" None is besides at most 0.6 % of what gravity adds to a velocity in a step (and at least 1e-6), so that contact
            forces at rest err by no more at short steps.
        stabilization: What removes overlap: "baumgarte" (a velocity bias), "split" (a second solve that moves positions only) or "none".
        baumgarte: Fraction of the overlap beyond the slop that is removed per step, 0 to 1.
        slop: Overlap that is left alone, in m (rad for hinge limits).
        max_correction_speed: Fastest correction of overlap, in m/s.
        restitution_threshold: A touching contact slower than this before the step rests instead of bouncing, in m/s.
        max_contacts: Contacts that one environment has room for; None lets the model decide. Contacts without room are left out and
            the step says CONTACTS_FULL.
    """

    timestep: float | None = None
    contact: Literal["hard", "mujoco"] = "hard"
    integrator: Literal["euler", "midpoint", "implicit", "implicitfast", "discrete", "rk4"] | None = None
    solver: Literal["auto", "pgs", "newton"] = "auto"
    iterations: int = 50
    tolerance: float | None = None
    stabilization: Literal["baumgarte", "split", "none"] = "split"
    baumgarte: float = 0.2
    slop: float = 1e-5
    max_correction_speed: float = 1.0
    restitution_threshold: float = 0.01
    max_contacts: int | None = None

    @classmethod
    def from_model(cls, model: Model) -> Options:
        """Options that reproduce the model's source in MuJoCo: `contact="mujoco"` and the source's integrator.

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
