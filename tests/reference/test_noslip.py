"""MuJoCo's noslip sweeps under its contact law: one step from the same state gives MuJoCo's velocity, and what should stick stays."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES
from mujoco_law.parity import AGREES, compare, states
from test_mujoco_law import LEFT_OUT, OTHER_POINTS, SCENE, SCENES, compiled

# Sweeps do the same in the same order, so that velocities after a step agree as without them. What MuJoCo itself does with a problem
# that its conjugate gradient method has solved instead of Newton's is the spread, as in test_mujoco_law.py.
SWEEPS, TOLERANCE = 20, 1e-6
"""What a file may ask for; the tolerance is MuJoCo's default."""


def without_slip(source, sweeps=SWEEPS, tolerance=TOLERANCE, **options):
    """A compiled model with noslip sweeps.

    MuJoCo's solution before them is to the last digit: an error of 1e-9 m/s^2 in a stiff contact, which the solution hides, is one of
    1e-6 N in the normal force that the sweeps hold.
    """
    return compiled(source, noslip_iterations=sweeps, noslip_tolerance=tolerance, tolerance=1e-16, **options)


def changes(model, found):
    """Share of states in which the sweeps change the velocity after the step."""
    plain = compare(stepper.load(model, strict=False).replace(noslip_iterations=0), found)
    return float(np.mean(plain.error > AGREES))


@pytest.mark.parametrize("sweeps", [(1, 0.0), (SWEEPS, TOLERANCE), (SWEEPS, 0.0)])
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_of_the_law_steps_as_in_mujoco(name, sweeps):
    parts = {part: "" for part in ("option", "geom", "joint", "floor", "ball", "more")} | SCENES[name]
    model = without_slip(SCENE.format(**parts), *sweeps)
    found = states(model, 12)
    step = compare(stepper.load(model, strict=False), found)
    assert step.touching > 0.5
    assert step.same > 0.5
    assert step.agrees == 1.0
    assert changes(model, found) > 0.0 or "condim 1" in name


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "implicit", "discrete", "rk4"])
def test_every_cone_with_every_integrator(cone, integrator):
    cone, integrator = getattr(mujoco.mjtCone, f"mjCONE_{cone.upper()}"), getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model = without_slip(SOURCES["dm_control/quadruped"], cone=int(cone), integrator=int(integrator))
    found = states(model, 12)
    step = compare(stepper.load(model, strict=False), found)
    assert step.touching > 0.5
    assert step.agrees == 1.0
    assert changes(model, found) > 0.3


@pytest.mark.parametrize("name", sorted(set(SOURCES) - set(LEFT_OUT)))
def test_robots_of_others_step_as_in_mujoco(name):
    step = compare(stepper.load(model := without_slip(SOURCES[name]), strict=False), states(model, 12))
    assert step.agrees == 1.0
    assert step.same == 1.0 or name in OTHER_POINTS


BLOCK = """<mujoco><option timestep=".002" cone="{cone}" noslip_iterations="{sweeps}" gravity="4.0 0 -8.96"/>
  <worldbody><geom type="plane" size="3 3 .1" friction="{friction}"/>
  <body pos="0 0 .0499"><freejoint/><geom type="box" size=".1 .1 .05" mass="1" friction="{friction}"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_a_block_on_a_slope_creeps_without_the_sweeps_and_stays_with_them(cone):
    """The regularised law creeps by more than a millimetre a second, and the sweeps leave less than a hundredth of that.

    The slope is 0.446 and friction 1.5, of which a pyramid may have half along each axis; friction 0.3 slides with the sweeps, too.
    """
    moved = {}
    for sweeps in (0, 20):
        model = stepper.load(BLOCK.format(cone=cone, sweeps=sweeps, friction=1.5))
        sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
        sim.step(nstep=500)
        start = sim.qpos[0]
        sim.step(nstep=500)
        moved[sweeps] = sim.qpos[0] - start
        assert (sim.iterations > sim.newton_steps) == (sweeps > 0)
    assert moved[0] > 1e-3
    assert abs(moved[20]) < 1e-2 * moved[0]
    model = stepper.load(BLOCK.format(cone=cone, sweeps=20, friction=0.3))
    sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
    sim.step(nstep=500)
    assert sim.qpos[0] > 0.1


GRIPPER = """<mujoco><option timestep=".002" cone="elliptic" noslip_iterations="{sweeps}"/>
  <default><geom friction="1 .02 .001" condim="4"/></default>
  <worldbody><body name="left" pos="-.06 0 .2"><joint name="left" type="slide" axis="1 0 0" damping="5"/>
    <geom type="box" size=".02 .03 .03" mass=".2"/></body>
  <body name="right" pos=".06 0 .2"><joint name="right" type="slide" axis="-1 0 0" damping="5"/>
    <geom type="box" size=".02 .03 .03" mass=".2"/></body>
  <body name="cube" pos="0 0 .2"><freejoint/><geom type="box" size=".0401 .02 .02" mass=".3"/></body></worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>"""


def test_a_gripper_holds_a_cube():
    """5 N at each side hold 3 N by friction 1; the cube creeps down without the sweeps, and by less than a hundredth of that with them."""
    sunk = {}
    for sweeps in (0, 30):
        model = stepper.load(GRIPPER.format(sweeps=sweeps))
        sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
        sim.step(np.array([5.0, 5.0]), nstep=250)
        start = sim.qpos[4]
        sim.step(np.array([5.0, 5.0]), nstep=500)
        sunk[sweeps] = start - sim.qpos[4]
    assert sunk[0] > 1e-3
    assert abs(sunk[30]) < 1e-2 * sunk[0]


def test_what_the_model_says():
    model = stepper.load(BLOCK.format(cone="elliptic", sweeps=7, friction=0.8))
    assert model.noslip_iterations == 7
    assert model.noslip_tolerance == 1e-6
    assert not model.omitted
    text = model.explain()
    assert "noslip: the source sets noslip_iterations=7" in text
    assert "7 noslip iterations at most with MuJoCo's contact law; hard contact ignores them" in text
    other = model.replace(noslip_iterations=3, noslip_tolerance=1e-8)
    assert (other.noslip_iterations, other.noslip_tolerance) == (3, 1e-8)
    back = stepper.Model.from_bytes(other.to_bytes())
    assert back == other
    assert other != model
    for wrong in (2.5, -1.0, np.nan):
        with pytest.raises(stepper.ModelError, match="noslip_iterations"):
            model.replace(noslip_iterations=wrong)
    with pytest.raises(stepper.ModelError, match="noslip_tolerance"):
        model.replace(noslip_tolerance=-1e-6)


def test_hard_contact_makes_no_sweeps_of_it():
    bits = []
    for sweeps in (0, 20):
        sim = stepper.Stepper(stepper.load(BLOCK.format(cone="elliptic", sweeps=sweeps, friction=0.3)))
        sim.step(nstep=200)
        bits.append(sim.qpos.tobytes())
    assert bits[0] == bits[1]


def test_implicit_derivatives_are_refused_by_name_and_differences_are_not():
    model = stepper.load(BLOCK.format(cone="elliptic", sweeps=20, friction=0.8))
    sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
    sim.step(nstep=100)
    with pytest.raises(ValueError, match=r"noslip_iterations is 20, must be 0 for method='implicit'.*method='fd'"):
        sim.linearize(method="implicit")
    assert np.isfinite(sim.linearize(method="fd").A).all()
