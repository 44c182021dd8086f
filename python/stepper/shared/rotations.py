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
