"""Conversions of unit quaternions and rotation matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def matrices(quat: NDArray[Any]) -> NDArray[Any]:
    """Rotation matrices (..., 3, 3) of unit quaternions (w, x, y, z), (..., 4)."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rows = [
        *(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        *(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        *(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ]
    return np.stack(rows, axis=-1).reshape(*quat.shape[:-1], 3, 3)


def about_vertical(angle: NDArray[Any]) -> NDArray[Any]:
    """Unit quaternions (w, x, y, z), (..., 4), of turns about the z axis by angles (...), rad."""
    half = 0.5 * angle
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def rotation_vectors(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Rotation vectors (..., 3), rad, of the turns from unit quaternions a to b, (..., 4), in the frame of a."""
    w = (a * b).sum(axis=-1, keepdims=True)
    v = a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:] - np.cross(a[..., 1:], b[..., 1:])
    v = v * np.where(w < 0, -1.0, 1.0)
    s = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(np.where(s > 1e-12, 2 * np.arctan2(s, np.abs(w)) / np.maximum(s, 1e-300), 2.0) * v)
