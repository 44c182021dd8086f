"""Study of a box that slides until friction stops it, 30 degrees off the axes: `stepper chart` compares engines."""

import math
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

SPEED, FRICTION, GRAVITY, ANGLE = 2.0, 0.5, 9.81, math.radians(30.0)
"""Initial speed, m/s; coefficient of friction; gravity, m/s^2; angle between the motion and the x axis, rad."""


def start(world: stepper.lab.World, _rngs: object) -> tuple[NDArray[Any], NDArray[Any]]:
    """Initial positions (num_envs, 7), m, and velocities (num_envs, 6), m/s: on the floor, with the initial speed."""
    qvel = SPEED * np.array([math.cos(ANGLE), math.sin(ANGLE), 0.0, 0.0, 0.0, 0.0])
    return np.tile(world.model.qpos0, (world.num_envs, 1)), np.tile(qvel, (world.num_envs, 1))


study = stepper.lab.Study(
    name="slide",
    model=f"""<mujoco><option gravity="0 0 -{GRAVITY}"/><default><geom friction="{FRICTION} 0 0"/></default>
      <worldbody><geom type="plane" size="5 5 1"/><body pos="0 0 .05"><freejoint/><geom type="box" size=".1 .1 .05" mass="1"/></body>
      </worldbody></mujoco>""",
    start=start,
    seconds=1.0,
    episodes=1,
)
