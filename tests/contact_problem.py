"""The constraint problem of one Euler step, built again from MuJoCo's mass matrix and Jacobians: contact.md sections 1 and 2 in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from models import forward, full_mass_matrix


@dataclass
class Problem:
    """Rows (n, t1, t2) of every contact: M, J, impulses, bias, velocity after the step, Delassus matrix, friction."""

    mass: np.ndarray
    jacobian: np.ndarray
    impulse: np.ndarray
    bias: np.ndarray
    free_velocity: np.ndarray
    friction: np.ndarray

    @property
    def delassus(self) -> np.ndarray:
        return self.jacobian @ np.linalg.solve(self.mass, self.jacobian.T)

    @property
    def next_velocity(self) -> np.ndarray:
        """Of the degrees of freedom: v_free + M^-1 J^T lambda."""
        return self.free_velocity + np.linalg.solve(self.mass, self.jacobian.T @ self.impulse.ravel())

    @property
    def contact_velocity(self) -> np.ndarray:
        """Of the contacts after the step, (n, 3)."""
        return (self.jacobian @ self.next_velocity).reshape(-1, 3)

    def residual(self) -> float:
        """Max |lambda - P_K(lambda - rho u)| / rho with u = v + (mu |v_t|, 0, 0) and rho = 3 / trace(G_ii)."""
        worst, G = 0.0, self.delassus
        for i, (impulse, v, mu) in enumerate(zip(self.impulse, self.contact_velocity + self.bias, self.friction, strict=True)):
            rho = 3 / np.trace(G[3 * i : 3 * i + 3, 3 * i : 3 * i + 3])
            u = v + np.array([mu * np.hypot(v[1], v[2]), 0, 0])
            worst = max(worst, np.linalg.norm(impulse - project(impulse - rho * u, mu)) / rho)
        return worst


def project(x: np.ndarray, mu: float) -> np.ndarray:
    """The nearest point of the cone |x_t| <= mu x_n."""
    tangent = np.hypot(x[1], x[2])
    if tangent <= mu * x[0]:
        return x
    if mu * tangent <= -x[0]:
        return np.zeros(3)
    height = (mu * tangent + x[0]) / (1 + mu * mu)
    return np.concatenate([[height], mu * height * x[1:] / tangent])


def problem_of(model: mujoco.MjModel, before, contacts: np.ndarray, options, ctrl=None) -> Problem:
    """The problem that belongs to the contacts of an Euler step from the state `before` (qpos, qvel)."""
    h, data = options.timestep, forward(model, *before, ctrl)
    mass = full_mass_matrix(model, data) + h * np.diag(model.dof_damping)
    free = before[1] + h * np.linalg.solve(mass, data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)
    jacobian, bias, friction = np.zeros((len(contacts), 3, model.nv)), np.zeros((len(contacts), 3)), np.zeros(len(contacts))
    for i, contact in enumerate(contacts):
        sides = np.zeros((2, 3, model.nv))
        for side, body in zip(sides, contact["body"], strict=True):
            mujoco.mj_jac(model, data, side, None, contact["pos"], body)
        jacobian[i] = contact["frame"] @ (sides[1] - sides[0])
        overlap = max(-contact["distance"] - options.slop, 0.0)
        correction = min(options.baumgarte * overlap / h, options.max_correction_speed)
        bias[i, 0] = contact["distance"] / h if contact["distance"] >= 0 else -correction
        geoms = contact["geom"]
        friction[i] = model.geom_friction[geoms, 0].max() if model.geom_condim[geoms].max() > 1 else 0.0
    return Problem(mass, jacobian.reshape(-1, model.nv), contacts["force"] * h, bias, free, friction)
