"""Orientation and velocity of the base of a legged robot, whose free joint is the first joint of the model."""

from __future__ import annotations

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.task import Array, Moment, per_moment
from stepper.shared.rotations import matrices


@per_moment
def frame(now: Moment) -> Array:
    """Rotation matrices from the frame of the robot's base to the world, (num_envs, 3, 3)."""
    return matrices(now.qpos[:, 3:7])


def in_base(now: Moment, vectors: Array) -> Array:
    """Components of world vectors, (num_envs, 3), in the frame of the robot's base."""
    turned: Array = np.einsum("ni,nij->nj", vectors, frame(now))
    return turned


@per_moment
def linear_velocity(now: Moment) -> Array:
    """Linear velocity of the robot's base, in its frame, (num_envs, 3), m/s."""
    return in_base(now, now.qvel[:, :3])


@cache_per_model
def stance(model: Model) -> Array:
    """Joint angles of the keyframe "stance", (nu,), rad."""
    angles: Array = np.array(model.keyframe("stance").qpos[7:])
    return angles
