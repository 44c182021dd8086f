"""Contact forces of geoms, for rewards of legged robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.task import Array, TaskView
from stepper.shared.view import per_moment


def contact_forces(now: TaskView, geoms: Sequence[str], against: Sequence[str] | None = None) -> Array:
    """Returns the normal forces on geoms in the last time step, summed over the contacts of each geom, (num_envs, n), N.

    Args:
        now: View of the batch after a step, the argument of `Task.reward`.
        geoms: Names of the n geoms.
        against: Names of the geoms on the other side of the contacts that count; None counts contacts with any geom.

    Raises:
        KeyError: An unknown geom.
    """
    model, contacts = now.sim.model, _contacts(now)
    columns, others = _columns(model, tuple(geoms)), None if against is None else _columns(model, tuple(against)) >= 0
    forces = np.zeros(len(now.action) * len(geoms))
    for side in range(2):
        column = columns[contacts["geom"][:, side]]
        counts = column >= 0 if others is None else (column >= 0) & others[contacts["geom"][:, 1 - side]]
        places = contacts["env"][counts].astype(np.intp) * len(geoms) + column[counts]
        forces += np.bincount(places, contacts["force"][counts, 0], len(forces))
    return forces.reshape(-1, len(geoms))


@per_moment
def _contacts(now: TaskView) -> Array:
    """Contacts of all environments, in the format of `Stepper.contacts`, read once per moment (view of the batch after a step)."""
    contacts: Array = now.contacts()
    return contacts


@cache_per_model
def _columns(model: Model, geoms: tuple[str, ...]) -> Array:
    """Index in `geoms` of each geom of the model, (ngeom,); -1 for geoms that are not in `geoms`."""
    columns = np.full(model.ngeom, -1)
    columns[[model.geom(name).id for name in geoms]] = np.arange(len(geoms))
    return columns
