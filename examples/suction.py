"""Suction cup that picks boxes and carries them: the mass that it lifts and the acceleration at which a box slides off.

    python examples/suction.py    # thresholds, theory and simulation, as a table

A cup descends on a box, sucks with a force F, lifts it with an acceleration a, and carries it sideways. The box stays on the cup if and only
if F >= m (g + a). While the cup accelerates sideways by b, the box does not slide if mu (F - m g) >= m b. Each environment has a box of its own mass.

The actuator is MJCF's `adhesion`: its force pulls the cup and what it touches together, shared equally by all contacts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[Any]

FORCE, FRICTION, GRAVITY = 20.0, 0.5, 9.81
"""Suction force, N, coefficient of friction, and gravitational acceleration, m/s^2."""
LIFT, REACH = 2.0, 0.1
"""Acceleration of the cup upwards, m/s^2, and height to which it lifts, m."""
SCENE = f"""
<mujoco>
  <option timestep="0.002"/>
  <default><geom friction="{FRICTION} 0 0" condim="3"/></default>
  <worldbody>
    <geom name="table" type="plane" size="2 2 .1"/>
    <body name="box" pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05" mass="1"/></body>
    <body name="cup" mocap="true" pos="0 0 .14"><geom name="cup" type="box" size=".02 .02 .02"/></body>
  </worldbody>
  <actuator><adhesion name="suction" body="cup" gain="{FORCE}" ctrlrange="0 1"/></actuator>
</mujoco>
"""


def pick(masses: Array, sideways: float = 0.0, options: stepper.Options | None = None) -> tuple[stepper.Stepper, Array]:
    """Picks one box per mass.

    Args:
        masses: Masses of the boxes, (num_envs,), kg.
        sideways: Acceleration of the cup along x while it carries the box, m/s^2.
        options: Options of the stepper.

    Returns:
        The stepper at the end, and the largest distance between cup and box since the lift began, (num_envs,), m: along z, and along x.
    """
    model = stepper.load(SCENE)
    sim = stepper.Stepper(model, len(masses), options=options)
    box, h = model.body("box").id, model.timestep
    sim.randomize({"body_mass[box]": masses})
    pose = np.array([0.0, 0.0, 0.14])

    def move(steps: int, acceleration: Array, suction: float) -> Array:
        """Moves the cup from rest with an acceleration, (3,). Returns the box's largest displacement relative to the cup, (num_envs, 3)."""
        start, before = pose.copy(), sim.xpos[:, box] - pose
        largest = np.zeros((len(masses), 3))
        for k in range(1, steps + 1):
            pose[:] = start + acceleration * (k * h) ** 2 / 2
            sim.mocap_pos[:] = pose
            sim.step(np.full((len(masses), 1), suction))
            largest = np.maximum(largest, np.abs(sim.xpos[:, box] - pose - before))
        return largest

    move(200, np.array([0.0, 0.0, -0.02 / (200 * h) ** 2 * 2]), 0.0)
    move(50, np.zeros(3), 1.0)
    lifted = move(round(np.sqrt(2 * REACH / LIFT) / h), np.array([0.0, 0.0, LIFT]), 1.0)
    carried = move(100, np.array([sideways, 0.0, 0.0]), 1.0)
    return sim, np.c_[lifted[:, 2], carried[:, 0]]


def main() -> None:
    """Print the thresholds of both laws next to the theory."""
    masses = np.linspace(0.5, 2.5, 201)
    print("largest mass that the cup lifts")
    for contact in ("hard", "mujoco"):
        _, moved = pick(masses, options=stepper.Options(contact=contact))
        print(f"{contact:8} {masses[moved[:, 0] < 0.01].max():.2f} kg, theory {FORCE / (GRAVITY + LIFT):.3f} kg")


if __name__ == "__main__":
    main()
