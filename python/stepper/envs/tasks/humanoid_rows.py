"""Observations that both humanoids have."""

from __future__ import annotations

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.observations import Observation
from stepper.envs.task import Array, TaskView, Terms
from stepper.envs.tasks.base import NoisyTask


@cache_per_model
def _tendon_matrices(model: Model) -> tuple[Array, Array]:
    """Matrices L (nq, ntendon) and V (nv, ntendon): qpos @ L are the lengths of the fixed tendons, qvel @ V their velocities."""
    names = model.tendon_names
    lengths, rates = np.zeros((model.nq, len(names))), np.zeros((model.nv, len(names)))
    for k in range(len(names)):
        tendon = model.tendon(k)
        for joint, coefficient in zip(tendon.jntid.tolist(), tendon.coef.tolist(), strict=True):
            lengths[model.joint(joint).qposadr, k] = coefficient
            rates[model.joint(joint).dofadr, k] = coefficient
    return lengths, rates


def tendons(now: TaskView) -> Terms:
    """Returns the lengths and velocities of the fixed tendons, (num_envs, ntendon) each.

    The names in the result are "tendon_length" (m or rad) and "tendon_velocity" (m/s or rad/s).
    """
    lengths, rates = _tendon_matrices(now.sim.model)
    return {"tendon_length": now.qpos @ lengths, "tendon_velocity": now.qvel @ rates}


BODY_TABLES = (
    Observation("cinert", columns=slice(10, None)),
    Observation("cvel", columns=slice(6, None)),
    Observation("qfrc_actuator", columns=slice(6, None)),
    Observation("cfrc_ext", columns=slice(6, None)),
)
"""Observations of humanoids: quantities of all bodies except the world, and actuator forces on all joints except the free one."""


class HumanoidTask(NoisyTask):
    """Task of a humanoid. Abstract."""

    exclude_current_positions_from_observation: bool

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (348,) by default: positions, velocities, and those rows of `BODY_TABLES` that the task's arguments include.

        The positions x and y are left out by default.
        """
        return (
            Observation("qpos", columns=slice(2 * int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel"),
            *(table for table in BODY_TABLES if getattr(self, f"include_{table.name}_in_observation")),
        )
