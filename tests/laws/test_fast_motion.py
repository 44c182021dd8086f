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


STIFF = """<mujoco><worldbody><body><joint name="j" axis="0 0 1"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
  </worldbody><actuator><position joint="j" kp="1e5"/></actuator></mujoco>"""


# Hard contact evaluates servos at the end of the step, except with Euler's rule.
@pytest.mark.parametrize(
    ("contact", "integrator"), [("hard", "euler"), *(("mujoco", rule) for rule in ("euler", "implicitfast", "implicit", "rk4"))]
)
def test_an_explicit_servo_that_diverges_is_flagged_before_the_numbers_are_absurd(contact, integrator):
    """h^2 kp / I is 1e3, and a rule that evaluates the servo before the step multiplies the motion by about as much in each."""
    sim = stepper.Stepper(stepper.load(STIFF), options=stepper.Options(timestep=0.01, integrator=integrator, contact=contact))
    sim.set_state(qpos=[0.01])
    said, largest = 0, 0.0
    while not said & stepper.Status.UNRESOLVED:
        sim.step()
        said, largest = int(sim.status), abs(float(sim.qpos[0]))
        # rad: the first step leads to 7.7, with rk4 to 245. Without a flag, the second would lead to 6e3 or more.
        assert largest < 1e3
    assert largest > 0.01


def test_a_number_beyond_ten_to_the_ten_is_flagged_with_every_law():
    """MuJoCo resets an environment there. A body that slides has no scale of its own that would be too fast."""
    text = '<mujoco><worldbody><body><joint type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody></mujoco>'
    for contact, integrator in (("hard", "midpoint"), ("hard", "euler"), ("mujoco", "implicitfast")):
        sim = simulate(text, timestep=1e-3, integrator=integrator, contact=contact)
        for position, flagged in ((0.9e10, False), (1.1e10, True)):
            sim.set_state(qpos=[position])
            sim.step()
            assert bool(sim.status & stepper.Status.UNRESOLVED) == flagged
