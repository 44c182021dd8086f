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
