"""Scenes with very many geoms load and simulate right."""

import numpy as np
import pytest
import stepper
from stepper import Model
from stepper.loading.load import compile_source
from stepper.loading.mjcf import describe
from stepper.loading.origins import Origin

SCENE = """<mujoco><worldbody><geom type="box" size=".05 .05 .05"/>
<body pos="0 0 .15"><freejoint/><geom size=".05"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("count", [5_000, 70_000])
def test_a_ball_rests_on_one_of_many_fixed_boxes(count):
    """Up to 65,535 geoms the numbers of pairs form a square table, and above only moving geoms have rows: both find the same contact.

    MuJoCo's compiler is left out, because its time grows with the square of the number.
    """
    description = describe(compile_source(Origin(SCENE)))
    box, ball = description["geoms"]
    places = 0.1 * np.stack(np.unravel_index(np.arange(count), (300, 300)), axis=1)
    under = places[count // 2]
    boxes = [box | {"pos": [x - under[0], y - under[1], 0.0]} for x, y in places.tolist()]
    sim = stepper.Stepper(Model.from_description(description | {"geoms": [*boxes, ball]}, True), options=stepper.Options(timestep=5e-3))
    sim.step(nstep=200)
    (contact,) = sim.contacts()
    assert sorted(contact["geom"].tolist()) == [count // 2, count]
    # The slop, by which contacts overlap at rest.
    assert sim.qpos[:3] == pytest.approx([0, 0, 0.1], abs=2e-5)
    assert not sim.status & (stepper.Status.NOT_CONVERGED | stepper.Status.TUNNELLED)
