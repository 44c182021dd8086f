"""Motion that a step is too long for: it is said, and no energy comes of it."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, afloat, simulate


@pytest.mark.parametrize("integrator", ["midpoint", "implicit"])
@pytest.mark.parametrize("dt", [0.05, 0.1])
@pytest.mark.parametrize("name", ["dm_control/humanoid", "gymnasium/ant"])
def test_without_input_a_thrown_robot_gains_no_energy(name, dt, integrator):
    """Ten, then a hundred radians a second and more in every joint, no gravity, nothing to touch: limbs whirl by radians in a step."""
    model = afloat(name, gravity=False)
    for speed in (10.0, 100.0):
        sim, rng = simulate(model, timestep=dt, integrator=integrator), np.random.default_rng(5)
        sim.set_state(qvel=rng.normal(scale=speed, size=model.nv))
        start, said = sum(sim.energy()), 0
        for _ in range(200):
            sim.step()
            said |= int(sim.status)
            # Unresolved steps gain nothing; resolved ones have the error of their rule, (h omega)^2 of what is left when they begin.
            assert sum(sim.energy()) < 1.5 * start
        assert said & stepper.Status.UNRESOLVED
        assert not said & stepper.Status.NON_FINITE


@pytest.mark.parametrize("integrator", ["midpoint", "implicit"])
@pytest.mark.parametrize("dt", [0.05, 0.1])
def test_a_humanoid_under_random_control_stays_finite(dt, integrator):
    """On the floor, with motors that work on it: no speed beyond what its motors can give it."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/humanoid"]))
    for seed in range(4):
        sim, rng = simulate(model, timestep=dt, integrator=integrator), np.random.default_rng(seed)
        for _ in range(300):
            sim.step(rng.uniform(-1, 1, model.nu))
            assert not sim.status & stepper.Status.NON_FINITE
            # J: 21 motors, most of 40 N m, over the radian or two of a joint's range.
            assert sim.energy()[1] < 5e3


def test_a_fast_wheel_is_no_unresolved_motion():
    """Five radians a step about a fixed axis: no velocity-dependent force, nothing to resolve."""
    text = """<mujoco><worldbody><body><joint type="hinge" axis="0 0 1"/>
      <geom type="cylinder" size=".2 .05"/></body></worldbody></mujoco>"""
    sim = simulate(text, timestep=5e-3)
    sim.set_state(qvel=[1000.0])
    sim.step(nstep=1000)
    assert sim.status == stepper.Status.OK
    assert sim.qvel[0] == pytest.approx(1000.0, rel=1e-12)
