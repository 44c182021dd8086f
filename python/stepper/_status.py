"""What a step says of itself."""

from __future__ import annotations

from enum import IntFlag


class Status(IntFlag):
    """Flags of `Stepper.status`, one word per environment: all that happened during the last call of `step`."""

    OK = 0
    """Solved to the tolerance, finite, every contact held."""
    NOT_CONVERGED = 1
    """The residual of a step was above the tolerance; `Stepper.residual` says by how much."""
    NON_FINITE = 2
    """A step was not finite; the environment keeps its last finite state and its time stands still."""
    CONTACTS_FULL = 4
    """There were more contacts than `Options.max_contacts`; the ones found last were left out."""
    UNRESOLVED = 8
    """The time step was too long for the motion: joints that turn by half a radian in a step and more, and forces of inertia that make them
    turn faster still. Centrifugal and gyroscopic forces were left out, the kinetic energy was kept from growing by more than the work done,
    and no joint left the step with more than a radian a step. Take a shorter step. Not with integrator="euler", which goes on until a step
    is NON_FINITE."""
    TUNNELLED = 16
    """Something moved so fast that it may have passed through something thin: a smaller time step would tell."""
