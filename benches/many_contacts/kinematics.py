"""Inverse kinematics of arms."""

from collections.abc import Sequence

import mujoco
import numpy as np

from many_contacts.scene import Array

ROUNDS, DAMPING, NEAR, FARTHEST = 200, 1e-4, 1e-6, 0.2
"""Settings of the inverse kinematics.

In order: largest number of iterations, damping, tolerance of the error, and largest step of a joint per iteration (rad or m).
"""


class UnreachableError(Exception):
    """Error of a pose that a site cannot reach; the message has the site and the remaining error."""


def reach(model: mujoco.MjModel, qpos: Array, site: str, joints: Sequence[str], *, pos: Array, rot: Array) -> Array:
    """Configuration in which a site has a given pose, by damped least squares.

    Raises:
        UnreachableError: The remaining error is above 1 mm or 0.01 rad.
    """
    data, where = mujoco.MjData(model), model.site(site).id
    adr = [model.joint(name).qposadr[0] for name in joints]
    dof = [model.joint(name).dofadr[0] for name in joints]
    which = [model.joint(name).id for name in joints]
    low, high = np.where(model.jnt_limited[which, None], model.jnt_range[which], (-np.inf, np.inf)).T
    data.qpos[:] = qpos
    jacobian = np.zeros((6, model.nv))
    error = np.full(6, np.inf)
    for _ in range(ROUNDS):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        turn = rot @ data.site_xmat[where].reshape(3, 3).T
        error = np.concatenate([pos - data.site_xpos[where], _rotation_vector(turn)])
        if np.abs(error).max() < NEAR:
            break
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], where)
        j = jacobian[:, dof]
        step = j.T @ np.linalg.solve(j @ j.T + DAMPING * np.eye(6), error)
        data.qpos[adr] += step * min(1.0, FARTHEST / max(float(np.abs(step).max()), NEAR))
        data.qpos[adr] = np.clip(data.qpos[adr], low, high)
    if np.abs(error[:3]).max() > 1e-3 or np.abs(error[3:]).max() > 1e-2:
        raise UnreachableError(f"site {site} stays {error} from {pos}")
    found: Array = data.qpos.copy()
    return found


def _rotation_vector(turn: Array) -> Array:
    """Rotation vector (3,), rad, of a rotation matrix (3, 3)."""
    quat, out = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quat, turn.ravel())
    mujoco.mju_quat2Vel(out, quat, 1.0)
    return out


def eased(begin: Array, end: Array, blocks: int) -> Array:
    """Minimum-jerk interpolation from `begin` to `end` at `blocks` equally spaced times, (blocks, ...), at rest at both ends.

    The first entry is one interval after `begin`, and the last one equals `end`.
    """
    t = np.arange(1, blocks + 1) / blocks
    share = (t**3 * (10 - 15 * t + 6 * t**2)).reshape(-1, *([1] * begin.ndim))
    return np.asarray(begin + share * (end - begin))


def downwards(yaw: float) -> Array:
    """Rotation matrix (3, 3) of a hand whose z axis points down.

    The hand's x axis is horizontal, at the angle `yaw` (rad) from the x axis of the world.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
