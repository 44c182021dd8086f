"""Square roots of covariance matrices."""

from __future__ import annotations

import numpy as np

from stepper.sysid.inertia import Array

RIDGE = 1e-12
"""Relative increase of variances, so that a covariance that is singular to rounding has a root."""


def root_of(covariance: Array, ridge: float = 0.0) -> Array:
    """Lower-triangular (Cholesky) root of a covariance, or of several.

    Args:
        covariance: Covariance, (..., n, n), in squared units of its numbers, which may differ by many orders of magnitude.
        ridge: Relative increase of the variances.

    Returns:
        Root L with L L^T = covariance, (..., n, n).
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (std[..., :, None] * std[..., None, :])
    return np.asarray(np.linalg.cholesky(correlation + ridge * np.eye(std.shape[-1])) * std[..., :, None])
