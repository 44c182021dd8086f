"""Functions that all tasks of legged robots use: orientation and velocity of the base, the stance, and a check of the reward's weights.

The base has a free joint, which is the first joint of the model.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from numbers import Real

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
    """Linear velocity of the robot's base, in the frame of the base, (num_envs, 3), m/s."""
    return in_base(now, now.qvel[:, :3])


def check_sizes(task: object, *names: str) -> None:
    """Raises ValueError if one of the fields `names` of a task is not a finite number of at least 0."""
    for name in names:
        value = getattr(task, name)
        if not isinstance(value, Real) or not 0.0 <= float(value) < math.inf:
            raise ValueError(f"{name} is {value!r}, must be at least 0 and finite")


def check_weights(weights: Mapping[str, float] | None, terms: Collection[str]) -> None:
    """Checks the weights of a reward.

    Args:
        weights: Weights by name of the term, or None.
        terms: Names of all terms of the reward.

    Raises:
        TypeError: The weights are no mapping.
        ValueError: A weight belongs to no term, or is no finite number.
    """
    if not isinstance(weights, Mapping | None):
        raise TypeError(f'weights is {weights!r}, must be a mapping such as {{"pose": 0.5}}, or None for those of WEIGHTS')
    for name, weight in (weights or {}).items():
        if name not in terms:
            raise ValueError(f"weights has {name!r}, terms of the reward are {', '.join(terms)}")
        if not isinstance(weight, Real) or not math.isfinite(weight):
            raise ValueError(f"weights[{name!r}] is {weight!r}, must be a finite number")


@cache_per_model
def stance(model: Model) -> Array:
    """Joint angles of the keyframe "stance", (nu,), rad."""
    angles: Array = np.array(model.keyframe("stance").qpos[7:])
    return angles
