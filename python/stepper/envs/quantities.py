"""Quantities of bodies as MuJoCo lays them out, about the centre of mass of the whole robot, for robots that are one tree."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from stepper.envs.task import Array, Moment, Quantity, Terms, per_moment

ROOT = 1
"""The body that the tree begins with."""


@per_moment
def contact_wrenches(now: Moment) -> Array:
    """MuJoCo's cfrc_ext: torque (3) and force (3) of the last step's contacts on every body, (num_envs, nbody, 6), world axes.

    Torques are about the centre of mass of the whole robot. No force of `xfrc_applied` is in it, and none on the world.
    """
    wrench: Array = now.body_contact_force
    out: Array = np.empty_like(wrench)
    out[..., 3:] = wrench[..., :3]
    out[..., :3] = wrench[..., 3:] + _cross(_arms(now), wrench[..., :3])
    out[:, 0] = 0.0
    return out


@per_moment
def mass_centers(now: Moment) -> Array:
    """MuJoCo's xipos: centres of mass of the bodies, m: (num_envs, nbody, 3)."""
    centers: Array = now.xpos + np.einsum("nbij,bj->nbi", _rotations(now), now.sim.model.body_ipos)
    return centers


@per_moment
def _rotations(now: Moment) -> Array:
    """Rotation matrices of the bodies: (num_envs, nbody, 3, 3)."""
    return rotations(now.xquat)


@per_moment
def _arms(now: Moment) -> Array:
    """From the robot's centre of mass to those of the bodies, m: (num_envs, nbody, 3)."""
    arms: Array = mass_centers(now) - now.subtree_com[:, ROOT, None]
    return arms


def _cross(a: Array, b: Array) -> Array:
    """Cross product: (..., 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(a[..., i], b[..., j], out=out[..., k])
        out[..., k] -= a[..., j] * b[..., i]
    return out


def inertias(now: Moment) -> Array:
    """MuJoCo's cinert: inertia (xx, yy, zz, xy, xz, yz), mass times place (3) and mass, about the robot's centre: (num_envs, nbody, 10)."""
    model = now.sim.model
    mass = model.body_mass
    axes = _rotations(now) @ rotations(model.body_iquat).astype(now.xquat.dtype)
    arm = _arms(now)
    tensor = np.einsum("nbik,bk,nbjk->nbij", axes, model.body_inertia, axes) - mass[:, None, None] * arm[..., :, None] * arm[..., None, :]
    about = mass * np.einsum("nbi,nbi->nb", arm, arm)
    out = np.empty((*mass_centers(now).shape[:2], 10), dtype=now.xpos.dtype)
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        out[..., k] = tensor[..., i, j] + (about if i == j else 0.0)
    out[..., 6:9] = mass[:, None] * arm
    out[..., 9] = mass
    return out


def velocities(now: Moment) -> Array:
    """MuJoCo's cvel: angular (3) and linear (3) velocity of the bodies where the robot's centre of mass is: (num_envs, nbody, 6)."""
    arm = now.subtree_com[:, ROOT, None] - now.xpos
    return np.concatenate([now.body_angvel, now.body_linvel + _cross(now.body_angvel, arm)], axis=-1)


def rotations(quat: Array) -> Array:
    """Rotation matrices of quaternions: (..., 4) to (..., 3, 3)."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    out = np.empty((*quat.shape[:-1], 3, 3), dtype=quat.dtype)
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


@lru_cache(maxsize=8)
def _tendon_matrices(model: Any) -> tuple[Array, Array]:
    """What makes lengths of tendons of qpos, (nq, ntendon), and their velocities of qvel, (nv, ntendon)."""
    names = model.tendon_names
    lengths, rates = np.zeros((model.nq, len(names))), np.zeros((model.nv, len(names)))
    for k in range(len(names)):
        tendon = model.tendon(k)
        for joint, coefficient in zip(tendon.jntid.tolist(), tendon.coef.tolist(), strict=True):
            lengths[model.joint(joint).qposadr, k] = coefficient
            rates[model.joint(joint).dofadr, k] = coefficient
    return lengths, rates


def tendons(now: Moment) -> Terms:
    """Lengths and velocities of the fixed tendons, (num_envs, ntendon) each, as "tendon_length" and "tendon_velocity"."""
    lengths, rates = _tendon_matrices(now.sim.model)
    return {"tendon_length": now.qpos @ lengths, "tendon_velocity": now.qvel @ rates}


BODY_TABLES = (
    Quantity("cinert", of=inertias, columns=slice(10, None)),
    Quantity("cvel", of=velocities, columns=slice(6, None)),
    Quantity("qfrc_actuator", columns=slice(6, None)),
    Quantity("cfrc_ext", of=contact_wrenches, columns=slice(6, None)),
)
"""What humanoids observe of their bodies: of all but the world, and forces of all joints but the free one."""
