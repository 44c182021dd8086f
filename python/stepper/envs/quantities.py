"""Quantities of a robot with a base on a free joint: velocities, gravity and heading of the base, angles and velocities of joints, sites.

Each is a function of a `BatchView`, for observations and rewards of a task, `Observation(base_linvel)`, and for controllers and measures
of a study. It is computed once per step. The base is the body of the first free joint of the model, and the joints are all hinges and
slides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepper._quantities import headings
from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.task import TaskView
from stepper.shared.rotations import matrices
from stepper.shared.view import Array, BatchView, per_moment

__all__ = [
    "action_rate",
    "base_angvel",
    "base_height",
    "base_linvel",
    "base_rotation",
    "gravity",
    "heading",
    "in_base",
    "joint_pos",
    "joint_vel",
    "site_linvel",
]


@cache_per_model
def _base(model: Model) -> tuple[int, int]:
    """First coordinate and first degree of freedom of the base's free joint; a ValueError if there is none."""
    for joint in map(model.joint, range(model.njnt)):
        if joint.type == "free":
            return joint.qposadr, joint.dofadr
    raise ValueError("the model has no free joint, and thus no base: give its first body a <freejoint/>, or use other quantities")


@cache_per_model
def _joints(model: Model) -> tuple[slice | list[int], slice | list[int]]:
    """Coordinates and degrees of freedom of all hinges and slides; slices if they are contiguous."""
    joints = [joint for joint in map(model.joint, range(model.njnt)) if joint.type in ("hinge", "slide")]
    qpos, dofs = [joint.qposadr for joint in joints], [joint.dofadr for joint in joints]
    return _slice(qpos), _slice(dofs)


def _slice(rows: list[int]) -> slice | list[int]:
    """A slice of contiguous ascending rows, or the rows themselves."""
    return slice(rows[0], rows[-1] + 1) if rows and rows == [*range(rows[0], rows[-1] + 1)] else rows


@per_moment
def base_rotation(now: BatchView) -> Array:
    """Rotation matrices from the frame of the base to the world, (num_envs, 3, 3)."""
    at, _ = _base(now.model)
    return matrices(now.qpos[:, at + 3 : at + 7])


def in_base(now: BatchView, vectors: Array) -> Array:
    """Components in the frame of the base of vectors in the world, (num_envs, 3), in the same unit."""
    turned: Array = np.einsum("ni,nij->nj", vectors, base_rotation(now))
    return turned


@per_moment
def base_linvel(now: BatchView) -> Array:
    """Linear velocity of the base in the frame of the base, (num_envs, 3), m/s."""
    _, at = _base(now.model)
    return in_base(now, now.qvel[:, at : at + 3])


def base_angvel(now: BatchView) -> Array:
    """Angular velocity of the base in the frame of the base, (num_envs, 3), rad/s."""
    _, at = _base(now.model)
    rates: Array = now.qvel[:, at + 3 : at + 6]
    return rates


def base_height(now: BatchView) -> Array:
    """Height of the base, (num_envs,), m."""
    at, _ = _base(now.model)
    height: Array = now.qpos[:, at + 2]
    return height


@per_moment
def gravity(now: BatchView) -> Array:
    """Unit vector downwards in the frame of the base, (num_envs, 3): (0, 0, -1) for a level base."""
    return -base_rotation(now)[:, 2]


@per_moment
def heading(now: BatchView) -> Array:
    """Heading of the base: angle of its x axis about the vertical, (num_envs,), rad."""
    at, _ = _base(now.model)
    return headings(now.qpos[:, at + 3 : at + 7])


@per_moment
def joint_pos(now: BatchView) -> Array:
    """Positions of all hinges and slides minus those of `now.default_qpos`, (num_envs, n), rad or m."""
    rows, _ = _joints(now.model)
    offsets: Array = now.qpos[:, rows] - now.default_qpos[rows]
    return offsets


def joint_vel(now: BatchView) -> Array:
    """Velocities of all hinges and slides, (num_envs, n), rad/s or m/s."""
    _, rows = _joints(now.model)
    rates: Array = now.qvel[:, rows]
    return rates


def site_linvel(now: BatchView, sites: Sequence[str]) -> Array:
    """Linear velocities of sites along the axes of the world, (num_envs, n, 3), m/s.

    Args:
        now: View of the batch.
        sites: Names of the n sites.
    """
    rows, bodies = sites_of(now.model, tuple(sites))
    rates: Array = now.body_linvel[:, bodies] + np.cross(now.body_angvel[:, bodies], now.site_xpos[:, rows] - now.xpos[:, bodies])
    return rates


@cache_per_model
def sites_of(model: Model, names: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Indices of sites by name, and of the bodies to which they belong."""
    sites = [model.site(name) for name in names]
    return [site.id for site in sites], [site.bodyid for site in sites]


def action_rate(now: TaskView) -> Array:
    """Squared norm of the difference between the last two actions, (num_envs,), in the square of their unit."""
    change = now.action - now.previous_action
    rate: Array = np.einsum("ij,ij->i", change, change)
    return rate
