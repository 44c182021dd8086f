"""Settings of a step: theta."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Options:
    """Every choice of method that a step makes. Immutable; `dataclasses.replace` makes another.

    Out-of-range values raise `ValueError` when a `Stepper` is made with them.

    Attributes:
        timestep: Time step in s; None takes the model's own.
        integrator: "midpoint" (Moreau's rule, second order in free flight), "euler" (semi-implicit, first order), or "rk4"
            (Runge-Kutta-Munthe-Kaas of order 4 for environments without an active constraint in this step; the others take a midpoint
            step). All are implicit in joint damping, except rk4's smooth step.
        solver: "auto" or "pgs", which are the same until there is a second tier: projected Gauss-Seidel that solves every contact's own
            Coulomb problem exactly.
        iterations: Sweeps of the solver at the most; a step that runs out of them says NOT_CONVERGED in its status.
        tolerance: Natural-map residual at which the solver stops, in m/s; None is 1e-6, and 1e-4 with precision="f32".
        stabilization: What removes overlap: "baumgarte" (a velocity bias), "split" (a second solve that moves positions only) or "none".
        baumgarte: Fraction of the overlap beyond the slop that is removed per step, 0 to 1.
        slop: Overlap that is left alone, in m (rad for hinge limits).
        max_correction_speed: Fastest correction of overlap, in m/s.
        restitution_threshold: A touching contact slower than this before the step rests instead of bouncing, in m/s.
        max_contacts: Contacts that one environment has room for; None lets the model decide. Contacts without room are left out and
            the step says CONTACTS_FULL.
    """

    timestep: float | None = None
    integrator: str = "midpoint"
    solver: str = "auto"
    iterations: int = 50
    tolerance: float | None = None
    stabilization: str = "baumgarte"
    baumgarte: float = 0.2
    slop: float = 1e-5
    max_correction_speed: float = 1.0
    restitution_threshold: float = 0.01
    max_contacts: int | None = None
