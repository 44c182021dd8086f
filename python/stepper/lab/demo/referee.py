"""Referee of a race: contacts, penetration and energy, measured in the same way for all engines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.lab.engines import Array, mujoco_model
from stepper.shared.machine import require


@dataclass(frozen=True)
class Measured:
    """Measurements of the referee in some environments at one time.

    Attributes:
        contacts: Mean number of touching contact points per environment.
        penetration: Deepest overlap, m.
        kinetic_mean: Mean kinetic energy of an environment, J.
        kinetic_max: Largest kinetic energy of an environment, J.
    """

    contacts: float
    penetration: float
    kinetic_mean: float
    kinetic_max: float


class Referee:
    """Referee that measures states of all engines in the same way, with MuJoCo's collision detection and inertia matrix.

    Contact points count as touching if their distance is below `NEAR` plus the distance at which the model's contacts begin to exert
    forces. A body that rests a micrometre above the floor and one that sinks in therefore both touch it.
    """

    NEAR = 1e-4
    """Distance below which contact points count as touching, m, in addition to the model's own distance."""

    def __init__(self, path: str) -> None:
        self._mujoco = require("mujoco", "to measure both engines alike")
        self._model = mujoco_model(path)
        # Margin and gap grow by the same length: contacts are found farther away, and exert forces at the same distance as before.
        self._model.geom_margin[:] += 10 * self.NEAR
        self._model.geom_gap[:] += 10 * self.NEAR
        self._data = self._mujoco.MjData(self._model)

    def measure(self, qpos: Array, qvel: Array) -> Measured:
        """Measures contacts, penetration and energy of some states.

        Args:
            qpos: Positions, (n, nq), m and rad.
            qvel: Velocities, (n, nv), m/s and rad/s.

        Returns:
            Contacts, penetration and kinetic energy.
        """
        mujoco, model, data = self._mujoco, self._model, self._data
        contacts, deepest, kinetic = 0, 0.0, np.zeros(len(qpos))
        for env, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_collision(model, data)
            mujoco.mj_energyVel(model, data)
            distance = data.contact.dist
            contacts += int(np.count_nonzero(distance < data.contact.includemargin + self.NEAR))
            deepest = max(deepest, -float(np.min(distance, initial=0.0)))
            kinetic[env] = data.energy[1]
        return Measured(contacts / len(qpos), deepest, float(np.mean(kinetic)), float(np.max(kinetic)))
