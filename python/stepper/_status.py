"""Status flags of a simulation step (class `Status`)."""

from __future__ import annotations

from contextlib import suppress
from enum import IntFlag
from operator import index


class Status(IntFlag):
    """Flags of `Stepper.status`: one integer per environment, with the flags of all steps in the last call of `step`."""

    @classmethod
    def _missing_(cls, value: object) -> Status:
        with suppress(TypeError):
            value = index(value)  # type: ignore[arg-type]  # Integers of NumPy are no `int`.
        return super()._missing_(value)  # type: ignore[no-any-return]

    OK = 0
    """No flag is set: every step was solved to the tolerance, and no condition of another flag occurred."""
    NOT_CONVERGED = 1
    """The solver's residual was above the tolerance. `Stepper.residual` is the residual, and `Stepper.worst_row` the constraint with the
    largest one. `Stepper.save_problem` writes the constraint problem to a file.

    If the residual is above 0.01 m/s (and above ten times the tolerance), the step does not let impulses increase the kinetic energy, and
    limits joint velocities to one radian per step. A step in which large impulses that cancel each other jam a body has the same two
    limits and this flag. In such a jam, even a small residual can mean a large error of the energy."""
    NON_FINITE = 2
    """A step gave a state that is not finite. The bodies concerned keep their last finite state, and so do all bodies to which constraints
    connect them. Other bodies move on. If no body has a finite state, or a mocap pose is not finite, time does not advance either. The
    residual is infinite, and `Stepper.worst_row` names the joint, body or actuator whose number is not finite."""
    CONTACTS_FULL = 4
    """More contacts were found than `Options.max_contacts` allows; the last ones were dropped."""
    UNRESOLVED = 8
    """The time step is too long for the motion; use a shorter one. There are six cases:

    First, a joint turns too far in one step:

    * by half a radian while inertial forces accelerate it further; the step then leaves out centrifugal and gyroscopic forces
    * by half a revolution from constraint impulses, as in a jammed lever

    For either reason, the step limits joint velocities to one radian per step. The kinetic energy then increases by no more than the work
    done. With integrator="euler", forces are explicit and there is no such limit. The flag is set if a joint turns by more than half a
    revolution in a step while its speed grows by more than a tenth. With contact="mujoco", the flag is set for both reasons and does
    not change the motion.

    Second, the error of integrator="midpoint" or "implicit" adds too much energy. There are two bounds: a tenth of the kinetic energy per
    step, and a rate that doubles the kinetic energy within 0.1 s. Both bounds are twice as high where constraints change the velocity much.
    The flag does not change the motion. Whipping chains have such steps.

    Third, elastic impacts became inelastic, because Newton's law of impact has no plausible solution, as in a corner with much friction.

    Fourth, stiff servos kept changing between their bounds (force limits, torque-speed curves) in the iterations of the step. Some of
    their forces may be outside of their range.

    Fifth, a position, velocity or activation exceeds 1e10, where MuJoCo resets an environment.

    Sixth, a free body or one on a ball joint spins and tumbles so fast that the equation for its rotation has no solution."""
    TUNNELLED = 16
    """A fast geom may have passed through a thin one in a step. Use a shorter time step."""
    INFEASIBLE = 32
    """The constraints contradict each other: no velocity within the bounds of position correction satisfies all of them.

    The bounds are 5 m/s and 50 rad/s with the default `Options.max_correction_speed`, and proportional to this option. The solver
    proves the contradiction by impulses (Farkas' lemma). At these impulses, the target velocities of the constraints need more power than
    any velocity within the bounds gives. `Stepper.residual` is at least the largest shortfall of a constraint velocity below its target,
    m/s or rad/s, and `Stepper.worst_row` names this constraint. Examples: a body squeezed between two others, a weld out of reach, a
    contact whose normal passes through a hinge. The step satisfies the constraints as far as possible, in least squares. For links of a
    robot that overlap at the reference pose, load it with `stepper.load(..., overlaps="exclude")`."""
    DEEP = 64
    """A contact penetrates by more than 1 mm, a hundred times the default slop; see `Stepper.max_penetration`. Causes: bodies that
    overlap in the initial pose (`stepper.load(..., overlaps="exclude")` disables their contacts), and time steps too long for an impact
    between edges."""
    OVER_LIMIT = 128
    """A joint or tendon is beyond its range by more than 0.01 rad (slides and tendons: 0.01 m) after a step;
    see `Stepper.max_limit_violation`."""
    EQUALITY_VIOLATED = 256
    """The position error of an equality is above 1 mm or 1 mrad after a step; `Stepper.max_equality_violation` is the error. Causes:

    * a closed loop turns by a tenth of a radian or more in a step
    * `set_state` or a change of `eq_active` violates the equality
    * the equality is out of reach (INFEASIBLE)
    * stabilization="none"
    * contact="mujoco": equalities are soft, and the load is large"""
    INACCURATE = 512
    """The estimated error of a step, `Stepper.error_estimate`, exceeded `Options.error`. Causes:

    * an error smaller than the solver's tolerance permits
    * several impacts in a step
    * motion far too fast for the time step
    * a controller that oscillates in every substep"""

    def __str__(self) -> str:
        """Names of the set flags, such as "Status.INFEASIBLE | Status.DEEP". Bits without a name follow as one number."""
        names = [f"Status.{flag.name}" for flag in self]
        rest = int(self) & ~sum(Status)
        return " | ".join([*names, *([str(rest)] if rest else [])]) or "Status.OK"

    def __format__(self, spec: str) -> str:
        """Text of the flags: their names, or their integer value if the format is one for integers, such as "d"."""
        return int.__format__(self, spec) if spec else str(self)
