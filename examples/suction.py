"""Suction cup that picks boxes and carries them: the largest mass that it lifts, and that it carries sideways.

    python examples/suction.py    # thresholds, theory and simulation, as a table

A cup descends on a box, sucks with a force F, lifts it with an acceleration a, and carries it sideways. The box stays on the cup if and
only if F >= m (g + a). While the cup accelerates sideways by b, the box does not slide if mu (F - m g) >= m b. The boxes of the
environments differ in mass.

With MuJoCo's soft contact every box creeps under the cup by more than 2 mm, which counts as sliding here. The actuator is MJCF's
`adhesion`: its force pulls the cup and what it touches together, shared equally by all contacts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[Any]

FORCE, FRICTION, GRAVITY = 20.0, 0.5, 9.81
"""Suction force, N, coefficient of friction, and gravitational acceleration, m/s^2."""
LIFT, SIDEWAYS, REACH = 2.0, 3.0, 0.1
"""Accelerations of the cup upwards and sideways, m/s^2, and height to which it lifts, m."""
STAYS = 0.002
"""Largest displacement relative to the cup of a box that stays on it, m."""
SCENE = f"""
<mujoco>
  <option timestep="0.002"/>
  <default><geom friction="{FRICTION} 0 0" condim="3"/></default>
  <worldbody>
    <geom name="table" type="plane" size="2 2 .1"/>
    <body name="box" pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05" mass="1"/></body>
    <body name="cup" mocap="true" pos="0 0 .14"><geom name="cup" type="box" size=".05 .05 .02" gap=".002"/></body>
  </worldbody>
  <actuator><adhesion name="suction" body="cup" gain="{FORCE}" ctrlrange="0 1"/></actuator>
</mujoco>
"""


def pick(masses: Array, sideways: float = SIDEWAYS, options: stepper.Options | None = None) -> tuple[stepper.Stepper, Array]:
    """Picks one box per mass.

    Args:
        masses: Masses of the boxes, (num_envs,), kg.
        sideways: Acceleration of the cup along x while it carries the box, m/s^2.
        options: Options of the stepper.

    Returns:
        The stepper at the end, and the largest displacements of the boxes relative to the cup, (num_envs, 2), m: along z while it lifts,
        and along x while it carries.
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

    # The cup stops 1 mm above the box, which suction pulls up.
    move(200, np.array([0.0, 0.0, -0.019 / (200 * h) ** 2 * 2]), 0.0)
    move(50, np.zeros(3), 1.0)
    lifted = move(round(np.sqrt(2 * REACH / LIFT) / h), np.array([0.0, 0.0, LIFT]), 1.0)
    carried = move(100, np.array([sideways, 0.0, 0.0]), 1.0)
    return sim, np.c_[lifted[:, 2], carried[:, 0]]


def main() -> None:
    """Print the thresholds of both laws next to the theory."""
    masses = np.linspace(0.5, 2.5, 201)
    print("law      lifted      carried at 3 m/s^2")
    for contact in ("hard", "mujoco"):
        _, moved = pick(masses, SIDEWAYS, stepper.Options(contact=contact))
        lifted, carried = (masses[moved[:, column] < STAYS].max(initial=0.0) for column in (0, 1))
        print(f"{contact:8} {lifted:.2f} kg     {carried:.2f} kg")
    print(f"theory   {FORCE / (GRAVITY + LIFT):.3f} kg    {FRICTION * FORCE / (SIDEWAYS + FRICTION * GRAVITY):.3f} kg")


if __name__ == "__main__":
    main()
