"""What a step says of itself."""

from __future__ import annotations

from enum import IntFlag


class Status(IntFlag):
    """Flags of `Stepper.status`, one word per environment: all that happened during the last call of `step`."""

    OK = 0
    """Solved to the tolerance, finite, every contact held, nothing deep in another thing or far beyond its range."""
    NOT_CONVERGED = 1
    """The residual of a step was above the tolerance; `Stepper.residual` says by how much, `Stepper.worst_row` where, and
    `Stepper.save_problem` leaves the problem as a file. Above 0.01 m/s (and ten times the tolerance) the
    kinetic energy was kept from growing by impulses that do not solve the problem, and no joint left the step with more than a radian a
    step. So it was, and the flag is set, where impulses cancel in a jam and are so large that even a small residual leaves the energy
    undecided."""
    NON_FINITE = 2
    """A step was not finite; the environment keeps its last finite state and its time stands still."""
    CONTACTS_FULL = 4
    """There were more contacts than `Options.max_contacts`; the ones found last were left out."""
    UNRESOLVED = 8
    """The time step was too long for the motion: joints that turn by half a radian in a step and more, and forces of inertia that make them
    turn faster still; or impulses that throw a joint by half a turn in the step, as levers in a jam do. Centrifugal and gyroscopic
    forces were left out, the kinetic energy was kept from growing by more than the work done, and no joint left the step with more than a
    radian a step. Take a shorter step. Not with integrator="euler", which goes on until a step is NON_FINITE.

    Also a step of integrator="midpoint" whose error made energy: more than a tenth of the kinetic energy in the step, or so much that it
    would double within 0.1 s (twice that where constraints change the velocity). Its motion is left as it is. Whipping chains have
    such steps."""
    TUNNELLED = 16
    """Something moved so fast that it may have passed through something thin: a smaller time step would tell."""
    INFEASIBLE = 32
    """What constraints demand cannot be met, and a witness proves it: impulses that move nothing, or so little that no motion within the
    bounds of a correction (5 `max_correction_speed` in m/s, and 10 of that in rad/s) gives what they ask for. Overlaps that contradict one
    another, a weld out of reach, a contact whose normal passes a hinge. What can be met is, in the least squares of the rest. Where links
    of a robot overlap at the reference pose, `stepper.load(..., overlaps="exclude")` leaves out their contacts."""
    DEEP = 64
    """A contact overlapped by more than 1 mm: a hundred times the default slop, more than a contact that is solved keeps. `Stepper.depth`
    says by how much. Bodies that begin inside one another (`stepper.load(..., overlaps="exclude")` leaves out their contacts), and steps
    that do not resolve an impact between edges, are why."""
    OVER_LIMIT = 128
    """A joint or tendon was beyond its range by more than 0.01 rad (0.6 degrees; of slides and tendons 0.01 m) after a step: more than a
    hard stop gives. `Stepper.limit_overshoot` says by how much."""
    EQUALITY_VIOLATED = 256
    """The position error of an equality was above 1 mm or 1 mrad after a step: a loop has opened, a weld has turned or a coupling has
    slipped. `Stepper.max_equality_violation` gives the error. Causes: a loop that turns by a tenth of a radian and more in a step, a state
    that does not meet the equality, an equality out of reach (INFEASIBLE), stabilization="none". With MuJoCo's contact law equalities are
    soft, and a load of their size sets the flag, as a soft contact sets DEEP."""
