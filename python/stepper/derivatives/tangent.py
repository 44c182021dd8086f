"""Conversion of gradients with respect to qpos, between quaternions (for optimisers) and rotation vectors (tangent coordinates)."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model
from stepper.derivatives.perturbations import Array


@functools.lru_cache(maxsize=8)
def _places(model: Model) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Indices of rotations and of all other coordinates in qpos and in qvel.

    Returns:
        Indices in qpos and in qvel of all coordinates except rotations, (k,) each. Indices of quaternions in qpos, (count, 4), and of the
        corresponding angular velocities in qvel, (count, 3).
    """
    plain, turned = [], []
    for k in range(model.njnt):
        joint = model.joint(k)
        shifts = {"free": 3, "ball": 0}.get(joint.type, 1)
        plain += [(joint.qposadr + i, joint.dofadr + i) for i in range(shifts)]
        if joint.type in ("free", "ball"):
            turned.append((joint.qposadr + shifts, joint.dofadr + shifts))
    q, v = np.array(plain, dtype=np.int64).reshape(-1, 2).T
    quat, rotation = np.array(turned, dtype=np.int64).reshape(-1, 2).T
    return q, v, quat[:, None] + np.arange(4), rotation[:, None] + np.arange(3)


def _rates(quat: Array) -> Array:
    """Derivative of the quaternion q * exp(r / 2) with respect to the rotation vector r in the body's frame, at r = 0.

    The shape is (..., 4, 3), the unit is 1/rad. `quat` is the unit quaternion q, (..., 4). Twice the derivative has orthonormal columns.
    """
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rates: Array = 0.5 * np.stack([-x, -y, -z, w, -z, y, z, w, -x, -y, x, w], axis=-1).reshape(*quat.shape[:-1], 4, 3)
    return rates


def to_tangent(model: Model, qpos: Array, gradient: Array) -> Array:
    """Converts a gradient with respect to the entries of qpos, (..., nq), to a gradient in tangent coordinates, (..., nv)."""
    q, v, quat, rotation = _places(model)
    out = np.zeros((*gradient.shape[:-1], model.nv))
    out[..., v] = gradient[..., q]
    if len(quat):
        out[..., rotation] = np.einsum("...ij,...i->...j", _rates(qpos[..., quat]), gradient[..., quat])
    return out


def from_tangent(model: Model, qpos: Array, gradient: Array) -> Array:
    """Converts a gradient in tangent coordinates, (..., nv), to a gradient with respect to the entries of qpos, (..., nq).

    The result is orthogonal to the quaternions in qpos.
    """
    q, v, quat, rotation = _places(model)
    out = np.zeros((*gradient.shape[:-1], model.nq))
    out[..., q] = gradient[..., v]
    if len(quat):
        out[..., quat] = 4.0 * np.einsum("...ij,...j->...i", _rates(qpos[..., quat]), gradient[..., rotation])
    return out
