"""Dragging of a body with the mouse: a spring and a damper between a point of the body and the pointer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Stepper
from stepper.shared.rotations import matrices
from stepper.viewer.frames import values_of
from stepper.viewer.looks import Array

FREQUENCY = 10.0
"""Angular frequency of the spring that drags a body, rad/s.

The stiffness is the frequency squared times the effective mass at the dragged point. The frequency is that of
MuJoCo's viewer: the square root of the default of visual/map/stiffness, 100.
"""


@dataclass
class Drag:
    """Spring and damper that pull a point of a body, as in MuJoCo's viewer. The damping is critical for the effective mass at the point.

    Attributes:
        env: Index of the environment.
        body: Index of the body.
        point: Pulled point in the body's frame, (3,), m.
        target: Position of the pointer in the world, (3,), m.
        mass: Effective mass at the point, kg.
    """

    env: int
    body: int
    point: Array
    target: Array
    mass: float

    @classmethod
    def begin(cls, sim: Stepper, env: int, body: int, place: Array) -> Drag | None:
        """Starts to drag a body.

        Args:
            sim: The stepper.
            env: Index of the environment.
            body: Index of the body.
            place: Point of the body, in world coordinates, (3,), m.

        Returns:
            The spring and damper; None if the body cannot move.
        """
        mass = effective_mass(sim, env, body, place)
        if mass is None:
            return None
        rotation, origin = matrices(_row(sim, "xquat", env)[body]), _row(sim, "xpos", env)[body]
        return cls(env, body, rotation.T @ (place - origin), np.array(place), mass)

    def at(self, sim: Stepper) -> Array:
        """Position of the pulled point in the world, (3,), m."""
        rotation = matrices(_row(sim, "xquat", self.env)[self.body])
        place: Array = _row(sim, "xpos", self.env)[self.body] + rotation @ self.point
        return place

    def wrench(self, sim: Stepper, strength: float = 1.0) -> Array:
        """Force and torque by which spring and damper pull the body, (6,) in world axes, N and N m, for `Stepper.xfrc_applied`.

        The torque is about the body's centre of mass. `strength` is a factor of the stiffness.
        """
        origin, rotation = _row(sim, "xpos", self.env)[self.body], matrices(_row(sim, "xquat", self.env)[self.body])
        place = self.at(sim)
        spin = _row(sim, "body_angvel", self.env)[self.body]
        velocity = _row(sim, "body_linvel", self.env)[self.body] + np.cross(spin, place - origin)
        stiffness = strength * self.mass * FREQUENCY**2
        force = stiffness * (self.target - place) - 2 * np.sqrt(stiffness * self.mass) * velocity
        centre = origin + rotation @ sim.model.body_ipos[self.body]
        return np.concatenate([force, np.cross(place - centre, force)])


def effective_mass(sim: Stepper, env: int, body: int, place: Array) -> float | None:
    """Effective mass at a point of a body, kg: the harmonic mean of the masses for forces along x, y and z.

    The result is None if the point cannot move. The point `place`, (3,), m, is in world coordinates.
    """
    matrices_of_mass = np.asarray(sim.mass_matrix(), np.float64)
    mass = matrices_of_mass if sim.num_envs is None else matrices_of_mass[env]
    if not len(mass):
        return None
    jacobian = sim.jacobian(body=body)
    rows = np.asarray(jacobian if sim.num_envs is None else jacobian[env], np.float64)
    arm = place - _row(sim, "xpos", env)[body]
    moved = rows[:3] + np.cross(rows[3:].T, arm).T
    mobility = float(np.trace(moved @ np.linalg.solve(mass, moved.T))) / 3.0
    return 1.0 / mobility if mobility > 0 else None


def _row(sim: Stepper, name: str, env: int) -> Array:
    """Values of a quantity of a stepper in one environment, (...) float64, in its unit."""
    values: Array = values_of(sim, name, np.array([env]))[0]
    return values.astype(np.float64)
