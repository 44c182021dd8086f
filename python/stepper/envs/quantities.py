"""Quantities of bodies as MuJoCo lays them out, about the centre of mass of the whole robot, for robots that are one tree."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stepper._stepper import Model
from stepper.envs.task import Array, Moment, Quantity, Terms, per_moment

ROOT = 1
"""The body that the tree begins with."""


@per_moment
def contact_wrenches(now: Moment) -> Array:
    """MuJoCo's cfrc_ext: torque (3) and force (3) of the last step's contacts on every body, (num_envs, nbody, 6), world axes.

    Torques are about the centre of mass of the whole robot. No force of `xfrc_applied` is in it, and none on the world. After a reset it is
    zero, as Gymnasium leaves it.
    """
    listed, nbody = now.sim.contacts(), now.sim.model.nbody
    touching = np.flatnonzero(listed["force"][:, 0])
    env, frame = listed["env"][touching].astype(np.int64), listed["frame"][touching]
    wrench = np.empty((len(touching), 6))
    wrench[:, 3:] = np.einsum("nij,ni->nj", frame, listed["force"][touching])
    wrench[:, :3] = np.einsum("nij,ni->nj", frame, listed["torque"][touching])
    wrench[:, :3] += cross(listed["pos"][touching] - now.subtree_com[env, ROOT], wrench[:, 3:])
    out = np.zeros((len(now.qpos), nbody, 6), dtype=now.qpos.dtype)
    for side, sign in ((1, 1.0), (0, -1.0)):
        body = listed["body"][touching, side]
        some = np.flatnonzero(body)  # Not the world.
        rows = (env[some] * nbody + body[some])[:, None] * 6 + np.arange(6)
        np.add.at(out.reshape(-1), rows.ravel(), (sign * wrench[some]).ravel().astype(out.dtype))
    return out


@per_moment
def mass_centers(now: Moment) -> Array:
    """MuJoCo's xipos: centres of mass of the bodies, m: (num_envs, nbody, 3)."""
    xquat, ipos = now.xquat, now.sim.model.body_ipos.astype(now.xquat.dtype)
    axis = xquat[..., 1:]
    half = cross(axis, ipos) + xquat[..., :1] * ipos
    centers: Array = now.xpos + ipos + 2.0 * cross(axis, half)
    return centers


def inertias(now: Moment) -> Array:
    """MuJoCo's cinert: inertia (xx, yy, zz, xy, xz, yz), mass times place (3) and mass, about the robot's centre: (num_envs, nbody, 10)."""
    model, dtype = now.sim.model, now.xpos.dtype
    mass, moments = model.body_mass.astype(dtype), model.body_inertia.astype(dtype)
    axes = _principal_axes(now.xquat, model.body_iquat.astype(dtype))
    arm = np.ascontiguousarray(np.moveaxis(mass_centers(now) - now.subtree_com[:, ROOT, None], -1, 0))
    moved = mass * arm
    out = np.empty((*now.xpos.shape[:2], 10), dtype=dtype)
    trace = np.einsum("inb,inb->nb", moved, arm)
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        entry = sum(axes[i][m] * axes[j][m] * moments[:, m] for m in range(3)) - moved[i] * arm[j]
        out[..., k] = entry + trace if i == j else entry
    out[..., 6:9] = np.moveaxis(moved, 0, -1)
    out[..., 9] = mass
    return out


def velocities(now: Moment) -> Array:
    """MuJoCo's cvel: angular (3) and linear (3) velocity of the bodies where the robot's centre of mass is: (num_envs, nbody, 6)."""
    out = np.empty((*now.xpos.shape[:2], 6), dtype=now.xpos.dtype)
    out[..., :3] = now.body_angvel
    out[..., 3:] = now.body_linvel + cross(now.body_angvel, now.subtree_com[:, ROOT, None] - now.xpos)
    return out


def cross(a: Array, b: Array) -> Array:
    """Cross product: (..., 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(a[..., i], b[..., j], out=out[..., k])
        out[..., k] -= a[..., j] * b[..., i]
    return out


def _principal_axes(xquat: Array, iquat: Array) -> list[list[Array]]:
    """Rotation matrices of the bodies' principal axes of inertia, row by row: [3][3] of (num_envs, nbody)."""
    a, b, c, d = np.ascontiguousarray(np.moveaxis(xquat, -1, 0))
    e, f, g, h = iquat.T
    w, x = a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g
    y, z = a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


@lru_cache(maxsize=8)
def _tendon_matrices(model: Model) -> tuple[Array, Array]:
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
