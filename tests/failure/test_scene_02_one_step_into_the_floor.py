"""Scene 2: one step into the floor.

Right answer, by hand: h 0.005 m, v -1.5 m/s, dt 0.02 s, e 0.25: before the contact v - g dt = -1.6962 m/s, after it 0.25 * 1.6962 =
0.42405 m/s. The block ends on the floor, not below it.
"""

import pytest
import stepper
from test_scene_01_falling_block import SHAPES, block


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("stabilization", ["baumgarte", "split", "none"])
def test_velocity_after_the_contact(shape, stabilization):
    sim = block(shape, 0.005, -1.5, stabilization=stabilization)
    sim.step()
    # A dozen operations on numbers of order 1.
    assert sim.qvel[0] == pytest.approx(0.25 * (1.5 + 9.81 * 0.02), abs=1e-14)
    assert sim.qpos[0] == pytest.approx(0.0, abs=1e-15)
    assert sim.status == stepper.Status.OK
