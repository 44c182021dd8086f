"""Referee of a race: contacts, penetration and energy of states of any engine, measured alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.lab.engines import Array
from stepper.shared.machine import require


@dataclass(frozen=True)
class Measured:
    """Measurements of the referee in some environments, at one moment.

    Attributes:
        contacts: Touching pairs of geoms per environment, mean.
        penetration: Deepest overlap, m.
        kinetic_mean: Kinetic energy, mean, J.
        kinetic_max: Kinetic energy, largest, J.
    """

    contacts: float
    penetration: float
    kinetic_mean: float
    kinetic_max: float


class Referee:
    """Measures states of any engine with one yardstick: MuJoCo's collision detection and inertia matrix at the given qpos, qvel.

    Points nearer than `NEAR` to where the pair's contact pushes (the surface, or the model's margin above it) count as touching, so that
    neither an engine that rests a micrometre above the floor nor one that sinks in gains by it.
    """

    NEAR = 1e-4

    def __init__(self, path: str) -> None:
        self._mujoco = require("mujoco", "to measure both engines alike")
        self._model = self._mujoco.MjModel.from_xml_path(path)
        # A gap as wide as what the margin grows by: contacts are found further away, and push where they did.
        self._model.geom_margin[:] += 10 * self.NEAR
        self._model.geom_gap[:] += 10 * self.NEAR
        self._data = self._mujoco.MjData(self._model)

    def measure(self, qpos: Array, qvel: Array) -> Measured:
        """Measures environments.

        Args:
            qpos: (n, nq).
            qvel: (n, nv).

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
