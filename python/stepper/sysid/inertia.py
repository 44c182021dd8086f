"""Inertias that stay physical: the pseudo-inertia of a body and its log-Cholesky parameters.

The pseudo-inertia of a body of density rho is the 4 x 4 matrix

    J = integral rho [x; 1] [x; 1]^T dV = [[S, m c], [m c^T, m]],    S = trace(I) / 2 - I,

with mass m, centre of mass c, and inertia I about the origin of x. A body with this inertia exists if and only if J is positive definite
(Wensing, Kim and Slotine 2018). This includes the triangle inequality of the moments of inertia. The log-Cholesky parameters are the ten
numbers alpha, d1 to t3 in J = U U^T with

    U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]].

Any ten numbers thus give the inertia of a body (Rucker and Wensing, "Smooth parameterization of rigid-body inertia", IEEE RA-L 7(2), 2022,
equation 13).

Here x is measured in the body's inertial frame (centre of mass and principal axes of the model), in units of its radii of gyration. The
model's inertia then has all ten numbers 0, and a change of 1 is a large change for each of them.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]


def second_moments(inertia: Array) -> Array:
    """Second moments of mass along the principal axes, (..., 3), kg m^2, from principal moments of inertia: S = trace(I) / 2 - I."""
    return np.asarray(0.5 * inertia.sum(axis=-1, keepdims=True) - inertia)


def principal_moments(moments: Array) -> Array:
    """Principal moments of inertia, (..., 3), kg m^2, from second moments: I = trace(S) - S."""
    return np.asarray(moments.sum(axis=-1, keepdims=True) - moments)


def factor(theta: Array) -> Array:
    """Triangular matrices U of pseudo-inertias U U^T, (..., 4, 4), from log-Cholesky parameters, (..., 10)."""
    alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3 = np.moveaxis(theta, -1, 0)
    U = np.zeros((*theta.shape[:-1], 4, 4))
    for k, d in enumerate((d1, d2, d3)):
        U[..., k, k] = np.exp(d)
    U[..., 3, 3] = 1.0
    U[..., 0, 1], U[..., 1, 2], U[..., 0, 2] = s12, s23, s13
    U[..., 0, 3], U[..., 1, 3], U[..., 2, 3] = t1, t2, t3
    return np.asarray(np.exp(alpha)[..., None, None] * U)


def bodies(theta: Array, mass: float, inertia: Array) -> tuple[Array, Array, Array, Array]:
    """Inertial parameters of bodies from log-Cholesky parameters theta, relative to a reference body, for which theta is 0.

    Args:
        theta: Log-Cholesky parameters theta, (..., 10).
        mass: Mass of the reference body, kg.
        inertia: Principal moments of inertia of the reference body, (3,), kg m^2.

    Returns:
        Masses (...,); centres of mass (..., 3) in m; principal moments (..., 3); and principal axes, the columns of rotations (..., 3, 3).
        Centres and axes are in the inertial frame of the reference body.
    """
    gyration = np.sqrt(np.maximum(second_moments(inertia), 1e-12 * inertia.max()) / mass)
    U = factor(theta)
    scale = np.append(gyration, 1.0)[:, None]
    J = mass * (scale * U) @ np.swapaxes(scale * U, -1, -2)
    m = J[..., 3, 3]
    c = J[..., :3, 3] / m[..., None]
    S = J[..., :3, :3] - m[..., None, None] * c[..., :, None] * c[..., None, :]
    moments, axes = np.linalg.eigh(S)
    axes = axes * np.where(np.linalg.det(axes) < 0, -1.0, 1.0)[..., None, None]
    return m, c, principal_moments(moments), axes


def tensor(inertia: Array, axes: Array) -> Array:
    """Inertia about the centre of mass, (..., 6) as xx, yy, zz, xy, xz, yz, kg m^2.

    Args:
        inertia: Principal moments, (..., 3), kg m^2.
        axes: Principal axes, the columns of rotation matrices (..., 3, 3).
    """
    full = (axes * inertia[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.stack([full[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=-1)


def quaternion(R: Array) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3), as eigenvectors of Bar-Itzhack's matrix; accurate at every angle."""
    m = np.moveaxis(R, (-2, -1), (0, 1))
    K = np.zeros((*R.shape[:-2], 4, 4))
    K[..., 0, 0] = m[0, 0] + m[1, 1] + m[2, 2]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        K[..., 0, 1 + i] = K[..., 1 + i, 0] = m[k, j] - m[j, k]
        K[..., 1 + i, 1 + i] = m[i, i] - m[j, j] - m[k, k]
        K[..., 1 + i, 1 + j] = K[..., 1 + j, 1 + i] = m[j, i] + m[i, j]
    return np.asarray(np.linalg.eigh(K)[1][..., -1])
