"""Scene 1: a block falls on the floor in one dimension.

Right answer: the textbook's recursion, step for step, contact included: v <- v - g dt, then h <- h + v dt; where that is below the floor,
h <- 0 and v <- -e v. Height 0.20 m, velocity -0.10 m/s, dt 0.02 s, g 9.81 m/s^2, e 0.25: after 8 steps h 0.0427, v -1.6696. Any other
order of updates misses it. h is the height of the block's lowest point.
"""

import pytest
import stepper
from models import simulate

DT, G, E = 0.02, 9.81, 0.25

BLOCK = """<mujoco><option timestep="0.02"/><worldbody><geom type="plane" size="0 0 1"/>
  <body pos="0 0 {half}"><joint type="slide" axis="0 0 1"/><geom {geom}/></body></worldbody></mujoco>"""
SHAPES = {"box": 'type="box" size=".1 .1 .1"', "sphere": 'type="sphere" size=".1"', "capsule": 'type="capsule" size=".1 .2" euler="0 90 0"'}


def recursion(h: float, v: float):
    """The textbook's states, for ever."""
    while True:
        v -= G * DT
        h += v * DT
        if h < 0:
            h, v = 0.0, -E * v
        yield h, v


def block(shape: str, h: float, v: float, **options) -> stepper.Stepper:
    """The block h above the floor; joint position 0 is touching."""
    model = stepper.load(BLOCK.format(half=0.1, geom=SHAPES[shape])).replace(geom_restitution=[E, E])
    sim = simulate(model, integrator="euler", **options)
    sim.set_state(qpos=[h], qvel=[v])
    return sim


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("stabilization", ["baumgarte", "split", "none"])
def test_the_recursion_step_for_step(shape, stabilization):
    """A hundred steps with no speed too slow to bounce: falls, and about a dozen bounces down to the recursion's own fixed point."""
    sim = block(shape, 0.20, -0.10, stabilization=stabilization, restitution_threshold=0.0)
    bounces = 0
    for k, (h, v) in zip(range(1, 101), recursion(0.20, -0.10), strict=False):
        sim.step()
        # A hundred additions of numbers of order 1; a bounce divides by the mass and multiplies by it.
        assert sim.qpos[0] == pytest.approx(h, abs=1e-13)
        assert sim.qvel[0] == pytest.approx(v, abs=1e-12)
        bounces += v > 0
        if k == 8:
            assert (round(sim.qpos[0], 4), round(sim.qvel[0], 4)) == (0.0427, -1.6696)
    assert bounces > 12


@pytest.mark.parametrize("shape", SHAPES)
def test_with_default_settings_it_follows_until_it_rests(shape):
    """The recursion never rests: it ends in a bounce of e g dt / (1 + e) every step, 0.039 m/s here.

    Blocks that approach more slowly than the threshold (1 cm/s) rest instead, which at a step of 2 ms comes before that bounce of 4 mm/s.
    """
    sim = block(shape, 0.20, -0.10)
    for _, (h, v) in zip(range(20), recursion(0.20, -0.10), strict=False):
        sim.step()
        assert (sim.qpos[0], sim.qvel[0]) == (pytest.approx(h, abs=1e-13), pytest.approx(v, abs=1e-12))
    fine = block(shape, 0.20, -0.10, timestep=2e-3, tolerance=1e-6)
    fine.step(nstep=1000)
    # One row alone is solved to rounding.
    assert fine.qvel[0] == pytest.approx(0.0, abs=1e-12)
    assert -fine.options.slop <= fine.qpos[0] <= 1e-12


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("stabilization", ["baumgarte", "split", "none"])
def test_velocity_after_one_step_into_the_floor(shape, stabilization):
    """Scene 2: h 0.005 m, v -1.5 m/s: v - g dt = -1.6962 m/s before the contact, 0.25 * 1.6962 m/s after it; it ends on the floor."""
    sim = block(shape, 0.005, -1.5, stabilization=stabilization)
    sim.step()
    # A dozen operations on numbers of order 1.
    assert sim.qvel[0] == pytest.approx(0.25 * (1.5 + 9.81 * 0.02), abs=1e-14)
    assert sim.qpos[0] == pytest.approx(0.0, abs=1e-15)
    assert sim.status == stepper.Status.OK
