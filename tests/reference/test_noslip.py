"""MuJoCo's noslip sweeps under its contact law: what should stick stays. test_mujoco_law.py compares single steps with MuJoCo's."""

import numpy as np
import pytest
import stepper

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
