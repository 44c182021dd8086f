"""Orientations as unit quaternions (w, x, y, z), by MuJoCo's functions."""

import mujoco
import numpy as np


def about(axis, angle: float) -> np.ndarray:
    """Quaternion of a turn by an angle (rad) about a unit vector."""
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, np.asarray(axis, float), angle)
    return quat


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Turn by b, then by a."""
    quat = np.zeros(4)
    mujoco.mju_mulQuat(quat, a, b)
    return quat


def matrix(quat: np.ndarray) -> np.ndarray:
    """Rotation matrix, (3, 3)."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, np.asarray(quat, float))
    return out.reshape(3, 3)
