"""The constraint problem of one step, built again from MuJoCo's mass matrix and Jacobians: contact.md sections 1 and 2 in NumPy.

Contacts of 3, 4 and 6 rows with their reported impulses; joint limits and equalities with the impulses that the change of velocity leaves
to them. Euler's rule takes it all at the state before; the midpoint rule at q + h/2 v, which is done here for balls, on which no force
depends on the velocity.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import mujoco
import numpy as np
from equalities import Rows, rows_of
from models import forward, full_mass_matrix

# How far limits are looked ahead, rad or m: LIMIT_SLACK of stage 4.
SLACK = 0.01

MAX_CURVED_OVERLAP = 1e-3
"""Overlap of a contact above which its curvature has no effect, m: the constant of the same name in tuning.rs."""


@dataclass
class Problem:
    """Rows (n, t1, t2) of every contact: M, J, impulses, bias, velocity after the step, Delassus matrix, friction.

    Attributes:
        turning: Rows of relative turning about the same axes, (3 n, nv).
        torque: Angular impulses along them, (n, 3).
        scale: What these rows are multiplied by so that their friction is `friction`, (n, 3); zeros in contacts without such friction.
        limits: Jacobian and bias of the joint limits that can be reached.
        ties: Jacobian and demanded velocity of the equalities, orthogonal in the metric of M.
        forced: Impulses of limits, then of equalities, as generalized impulses leave them.
    """

    mass: np.ndarray
    jacobian: np.ndarray
    impulse: np.ndarray
    bias: np.ndarray
    free_velocity: np.ndarray
    friction: np.ndarray
    turning: np.ndarray
    torque: np.ndarray
    scale: np.ndarray
    limits: tuple[np.ndarray, np.ndarray]
    ties: tuple[np.ndarray, np.ndarray]
    forced: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def delassus(self) -> np.ndarray:
        return self.jacobian @ np.linalg.solve(self.mass, self.jacobian.T)

    @property
    def scalars(self) -> np.ndarray:
        """Jacobian of limits, then of equalities."""
        return np.concatenate([self.limits[0], self.ties[0]])

    def _pushed(self) -> np.ndarray:
        """Generalized impulses of the contacts."""
        return self.jacobian.T @ self.impulse.ravel() + self.turning.T @ self.torque.ravel()

    def leave_to_scalars(self, velocity: np.ndarray) -> None:
        """Finds the impulses of limits and equalities that, with those of the contacts, give the velocity after the step."""
        rest = self.mass @ (velocity - self.free_velocity) - self._pushed()
        self.forced = np.linalg.lstsq(self.scalars.T, rest, rcond=1e-12)[0]

    @property
    def next_velocity(self) -> np.ndarray:
        """Of the degrees of freedom: v_free + M^-1 J^T lambda."""
        total = self._pushed() + (self.scalars.T @ self.forced if len(self.forced) else 0)
        return self.free_velocity + np.linalg.solve(self.mass, total)

    @property
    def contact_velocity(self) -> np.ndarray:
        """Of the contacts after the step, (n, 3)."""
        return (self.jacobian @ self.next_velocity).reshape(-1, 3)

    def residual(self) -> float:
        """Max |lambda - P_K(lambda - rho u)| / rho with u = v + (mu |v_t|, 0, ...) and rho = rows / trace(G_ii)."""
        worst, v = 0.0, self.next_velocity
        blocks = [self._block(i) for i in range(len(self.friction))]
        limits = self.limits[0]
        # All rows at once, since a call takes longer than its numbers.
        traces = self._mobilities(np.concatenate([limits, *(rows for rows, _ in blocks)]))
        at = len(limits)
        for i, ((rows, impulse), mu) in enumerate(zip(blocks, self.friction, strict=True)):
            velocity = rows @ v
            velocity[:3] += self.bias[i]
            rho = len(rows) / traces[at : at + len(rows)].sum()
            at += len(rows)
            velocity[0] += mu * np.linalg.norm(velocity[1:])
            worst = max(worst, np.linalg.norm(impulse - project(impulse - rho * velocity, mu)) / rho)
        count = len(limits)
        for row, bias, impulse, g in zip(*self.limits, self.forced[:count], traces[:count], strict=True):
            worst = max(worst, abs(impulse - max(impulse - (row @ v + bias) / g, 0.0)) * g)
        return max(worst, np.abs(self.ties[0] @ v - self.ties[1]).max(initial=0.0))

    def _mobilities(self, rows: np.ndarray) -> np.ndarray:
        """Diagonal of rows M^-1 rows'."""
        return (rows * np.linalg.solve(self.mass, rows.T).T).sum(axis=1)

    def _block(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        mine = slice(3 * i, 3 * i + 3)
        rows, impulse, scale = self.jacobian[mine], self.impulse[i], self.scale[i]
        if not scale.any():
            return rows, impulse
        turning = np.divide(self.torque[i], scale, out=np.zeros(3), where=scale > 0)
        # Torsional friction alone has one row of rotation.
        n = 3 if scale[1:].any() else 1
        return np.concatenate([rows, scale[:n, None] * self.turning[mine][:n]]), np.concatenate([impulse, turning[:n]])


def project(x: np.ndarray, mu: float) -> np.ndarray:
    """The nearest point of the cone |x_t| <= mu x_n."""
    tangent = np.linalg.norm(x[1:])
    if tangent <= mu * x[0]:
        return x
    if mu * tangent <= -x[0]:
        return np.zeros(len(x))
    height = (mu * tangent + x[0]) / (1 + mu * mu)
    return np.concatenate([[height], mu * height * x[1:] / tangent])


@lru_cache(maxsize=1)
def _data_of(model: mujoco.MjModel) -> mujoco.MjData:
    """Memory for the states of the model in use."""
    return mujoco.MjData(model)


def problem_of(model: mujoco.MjModel, before, contacts: np.ndarray, options, ctrl=None) -> Problem:
    """The problem that belongs to the contacts of a step from the state `before` (qpos, qvel)."""
    h, midpoint, qpos = options.timestep, options.integrator in (None, "midpoint"), before[0].copy()
    if midpoint:
        mujoco.mj_integratePos(model, qpos, before[1], h / 2)
    data = forward(model, qpos, before[1], ctrl, data=_data_of(model))
    mass = full_mass_matrix(model, data) + (h / 2 if midpoint else h) * np.diag(model.dof_damping)
    free = before[1] + h * np.linalg.solve(mass, data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)
    n = len(contacts)
    jacobian, turning, bias = np.zeros((n, 3, model.nv)), np.zeros((n, 3, model.nv)), np.zeros((n, 3))
    friction, scale = np.zeros(n), np.zeros((n, 3))
    for i, contact in enumerate(contacts):
        sides = np.zeros((2, 2, 3, model.nv))
        for side, body in zip(sides, contact["body"], strict=True):
            mujoco.mj_jac(model, data, side[0], side[1], contact["pos"], body)
        jacobian[i], turning[i] = contact["frame"] @ (sides[1] - sides[0])
        bias[i, 0] = demand_of(contact["distance"], h, options)
        if midpoint and contact["body"].all() and contact["distance"] >= -MAX_CURVED_OVERLAP:
            most = np.abs(jacobian[i, 1:] @ before[1])
            bias[i, 1:] = np.clip(h / 2 * contact["frame"][1:] @ curve(model, data, contact), -most, most)
        condim, mixed = model.geom_condim[contact["geom"]].max(), model.geom_friction[contact["geom"]].max(axis=0)
        friction[i] = mixed[0] if condim > 1 else 0.0
        scale[i] = mixed[[1, 2, 2]] * [condim > 3, condim > 4, condim > 4] / (mixed[0] or 1.0)
    rows = (jacobian.reshape(-1, model.nv), contacts["force"] * h, bias, free, friction, turning.reshape(-1, model.nv))
    ties = equalities(model, data, mass, before[1], options, midpoint=midpoint)
    return Problem(mass, *rows, contacts["torque"] * h, scale, limits(model, data, free, options), ties)


def demand_of(distance: float, h: float, options) -> float:
    """Bias of a row that may close a gap, or has to open an overlap."""
    overlap = max(-distance - options.slop, 0.0)
    return distance / h if distance >= 0 else -min(options.baumgarte * overlap / h, options.max_correction_speed)


def curve(model: mujoco.MjModel, data: mujoco.MjData, contact: np.ndarray) -> np.ndarray:
    """Rate of the relative velocity of two free balls at the place where they touch, as they move on without forces, m/s^2."""
    # u = v_b - v_a + omega_b x (p - x_b) - omega_a x (p - x_a), with constant v and omega. The place p shares the distance of the centres
    # as the radii do, and follows b along the normal.
    radii, centres, v, omega = [], [], [], []
    for geom, body in zip(contact["geom"], contact["body"], strict=True):
        assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        radii.append(model.geom_size[geom, 0] + contact["distance"] / 2)
        centres.append(data.xpos[body])
        v.append(velocity[3:])
        omega.append(velocity[:3])
    normal = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    apart = v[1] - v[0]
    place = v[1] - (apart - normal * (apart @ normal)) * radii[1] / sum(radii)
    return np.cross(omega[1], place - v[1]) - np.cross(omega[0], place - v[0])


def limits(model: mujoco.MjModel, data: mujoco.MjData, free: np.ndarray, options) -> tuple[np.ndarray, np.ndarray]:
    """The nearer end of the range of every hinge and slide that can reach it."""
    rows, biases = [], []
    for joint in np.flatnonzero(model.jnt_limited):
        dof, q, (low, high) = model.jnt_dofadr[joint], data.qpos[model.jnt_qposadr[joint]], model.jnt_range[joint]
        sign, distance = (1, q - low) if q - low <= high - q else (-1, high - q)
        if distance <= 2 * options.timestep * max(-sign * free[dof], 0.0) + SLACK:
            row = np.zeros(model.nv)
            row[dof] = sign
            rows.append(row)
            biases.append(demand_of(distance, options.timestep, options))
    return np.reshape(rows, (-1, model.nv)), np.array(biases)


def equalities(model, data, mass, qvel, options, *, midpoint: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rows made orthogonal one after the other, and what they ask of J v+: for the curvature no more than J v, and the correction."""
    none = Rows(np.zeros(0), np.zeros((0, model.nv)), np.zeros(0), np.zeros(0, int))
    rows, h = rows_of(model, data) if np.any(model.eq_active0) else none, options.timestep
    sides = np.stack([h / 2 * rows.curvature, rows.jacobian @ qvel, rows.correction(options, h, midpoint=midpoint)], axis=1)
    kept, moves, asked = [], [], []
    for jacobian, wanted in zip(rows.jacobian, sides, strict=True):
        row, side, move = jacobian.copy(), wanted.copy(), np.linalg.solve(mass, jacobian)
        size = row @ move
        for other, moved, known in zip(kept, moves, asked, strict=True):
            share = row @ moved / (other @ moved)
            row -= share * other
            move -= share * moved
            side -= share * known
        if row @ move > 1e-12 * size:
            kept.append(row)
            moves.append(move)
            asked.append(side)
    curve, before, correction = np.reshape(asked, (-1, 3)).T
    return np.reshape(kept, (-1, model.nv)), -np.clip(curve, -np.abs(before), np.abs(before)) - correction
