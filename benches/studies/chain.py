"""Study of a chain of five hinged links that falls from the horizontal without damping: order of convergence of the integrators."""

import math
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

_LINK = '<body pos="0 0 {z}"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".25"/>'


def start(world: stepper.lab.World, _rngs: object) -> tuple[NDArray[Any], NDArray[Any]]:
    """Initial positions (num_envs, 5), rad, and velocities (num_envs, 5), rad/s: at rest, straight and horizontal."""
    return np.tile([0.5 * math.pi, 0.0, 0.0, 0.0, 0.0], (world.num_envs, 1)), np.zeros((world.num_envs, 5))


study = stepper.lab.Study(
    name="chain",
    model='<mujoco><default><geom contype="0" conaffinity="0"/></default><worldbody>'
    + "".join(_LINK.format(z=1.5 if link == 0 else -0.2) for link in range(5))
    + "</body>" * 5
    + "</worldbody></mujoco>",
    start=start,
    seconds=1.0,
    episodes=1,
)
