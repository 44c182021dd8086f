"""A table on four legs, whose forces are not unique. They carry its weight, and the motion does not depend on which they are.

While a table slides on dry friction the distribution of the forces decides on the torque of friction, so that rigid bodies leave its motion
open; it is unique where it sticks and where there is no friction.
"""

import mujoco
import numpy as np
import pytest
import stepper
from models import simulate

LEGS = [(-0.4, -0.3), (0.4, -0.3), (-0.4, 0.3), (0.4, 0.3)]


def table(order, *, load: str = "") -> str:
    """A plate on four spheres, listed in an order, with something on it."""
    legs = "".join(f'<geom type="sphere" size=".05" pos="{LEGS[i][0]} {LEGS[i][1]} -.35" mass=".2"/>' for i in order)
    return f"""<mujoco><default><geom friction=".7"/></default><worldbody><geom type="plane" size="5 5 1"/>
      <body pos="0 0 .4"><freejoint/><geom type="box" size=".5 .4 .02" mass="5" contype="0" conaffinity="0"/>{legs}{load}</body>
      </worldbody></mujoco>"""


LOADS = {"nothing": "", "a corner": '<geom type="sphere" size=".05" pos=".3 .2 .1" mass="3" contype="0" conaffinity="0"/>'}


@pytest.mark.parametrize("load", LOADS)
def test_the_forces_carry_the_weight(load):
    """Sum of normal forces = m g, their moments balance the load's; each pushes."""
    model = mujoco.MjModel.from_xml_string(table(range(4), load=LOADS[load]))
    sim = simulate(model)
    sim.step(nstep=500)
    contacts = sim.contacts()
    normal, pos = contacts["force"][:, 0], contacts["pos"]
    weight = model.body_mass[1] * 9.81
    assert len(contacts) == 4
    assert (normal > 0).all()
    # The solver's tolerance in m/s, as a force: mass times tolerance over the step.
    tolerance = model.body_mass[1] * 1e-6 / sim.timestep
    assert normal.sum() == pytest.approx(weight, abs=tolerance)
    assert pos[:, :2].T @ normal / weight == pytest.approx(model.body_ipos[1, :2] + sim.qpos[:2], abs=tolerance / weight)
    assert np.abs(sim.qvel).max() < 1e-9


@pytest.mark.parametrize("order", [(3, 2, 1, 0), (2, 0, 3, 1)])
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("friction", [0.0, 0.7])
def test_the_motion_does_not_depend_on_the_order_of_the_legs(friction, load, order):
    """Frictionless it is thrown with a spin, and slides on; with friction it is set down softly, and sticks."""
    ends = []
    for legs in (range(4), order):
        source = table(legs, load=LOADS[load]).replace('friction=".7"', f'friction="{friction}"')
        sim = simulate(source, iterations=2000, tolerance=1e-10)
        sim.set_state(qvel=[0.5, 0.2, 0, 0, 0, 1.0] if friction == 0 else [0, 0, -0.01, 0, 0, 0])
        sim.step(nstep=1000)
        ends.append(np.concatenate([sim.qpos, sim.qvel]))
        assert sim.status == stepper.Status.OK
    # Each step is solved to 1e-10 m/s; two seconds gather that.
    assert ends[1] == pytest.approx(ends[0], abs=1e-8)
