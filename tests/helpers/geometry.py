"""Orientations as unit quaternions (w, x, y, z), by MuJoCo's functions, and vertices of meshes for MJCF."""

from collections.abc import Sequence

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


def vertices(corners: np.ndarray | Sequence[Sequence[float]]) -> str:
    """Vertex coordinates of a mesh as MJCF, m."""
    return " ".join(f"{x:.9g}" for corner in corners for x in corner)


def cuboid(x: float, y: float, z: float) -> str:
    """Vertices of a cuboid from its half sizes, m, as MJCF."""
    return vertices([(i * x, j * y, k * z) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])


def prism(sides: int, half: float, *, faces_at_half: bool = False) -> np.ndarray:
    """Corners of a regular prism along the z axis with the half length `half`, m, (2 sides, 3)."""
    # Edges along z are at the distance `half` from the axis, one of them at +x; with `faces_at_half`, side faces are.
    angles = (np.arange(sides) + 0.5 * faces_at_half) * 2 * np.pi / sides
    radius = half / np.cos(np.pi / sides) if faces_at_half else half
    return np.array([(radius * np.cos(a), radius * np.sin(a), z) for a in angles for z in (-half, half)])
