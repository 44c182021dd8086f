"""Equalities of every kind against one step of the same mathematics in NumPy, with MuJoCo's mass matrix, forces and Jacobians."""

import mujoco
import numpy as np
import pytest
import stepper
from contact_problem import equalities
from equalities import rows_of
from models import forward, full_mass_matrix, random_state, simulate

LINKAGE = """<mujoco><default><geom contype="0" conaffinity="0" density="300"/></default><worldbody>
  <site name="wall" pos=".1 .2 .9" euler="20 30 40"/>
  <body name="hand" mocap="true" pos=".3 .1 .8" euler="10 0 50"/>
  <body name="a" pos="0 0 1"><joint name="a1" axis="0 1 .2" ref=".3"/><joint name="a2" type="slide" axis="1 0 0"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/><site name="sa" pos=".3 .02 0" euler="5 6 7"/>
    <body name="b" pos=".3 0 0"><joint name="b1" type="ball" armature=".01"/><geom type="box" size=".1 .05 .03" pos=".1 0 0"/>
      <site name="sb" pos=".2 0 .01" euler="50 0 0"/>
      
        <body name="c" pos=".2 0 0"><joint name="c1" axis="0 0 1"/><geom type="capsule" size=".02" fromto="0 0 0 0 .2 0"/>
        </body></body></body>
  <body name="d" pos="1 0 1"><freejoint/><geom type="box" size=".1 .2 .05"/><site name="sd" pos=".1 0 0" euler="0 20 0"/></body>
  <body name="e" pos="-1 0 1"><joint name="e1" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .3"/>
    <body name="f" pos="0 0 .3"><joint name="f1" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .3"/></body></body>
  </worldbody>
  <tendon><fixed name="t1"><joint joint="e1" coef="1.5"/><joint joint="f1" coef="-.5"/></fixed>
    <fixed name="t2"><joint joint="c1" coef="1"/><joint joint="a1" coef=".7"/></fixed></tendon>
  <equality>{equality}</equality></mujoco>"""

KINDS = {
    "connect to the world": '<connect body1="c" body2="world" anchor="0 .2 0"/>',
    "connect from the world": '<connect body1="world" body2="c" anchor=".4 0 1"/>',
    "connect in a tree": '<connect body1="c" body2="a" anchor="0 .2 .1"/>',
    "connect of trees": '<connect body1="c" body2="d" anchor=".1 0 .2"/>',
    "connect of sites": '<connect site1="sb" site2="sd"/>',
    "weld": '<weld body1="b" body2="d"/>',
    "weld with a pose and a scale": '<weld body1="d" body2="f" anchor=".1 0 .1" relpose="1 .1 .2 .7 .1 .1 .7" torquescale=".3"/>',
    "weld without torque": '<weld body1="d" body2="world" torquescale="0"/>',
    "weld of sites": '<weld site1="sd" site2="wall"/>',
    "weld to a mocap body": '<weld body1="d" body2="hand"/>',
    "joint to joint": '<joint joint1="a1" joint2="e1" polycoef=".1 .8 -.3 .2 .1"/>',
    "joint": '<joint joint1="a1" polycoef=".2 0 0 0 0"/>',
    "tendon to tendon": '<tendon tendon1="t1" tendon2="t2" polycoef="0 1 .5 0 .2"/>',
    "tendon": '<tendon tendon1="t1" polycoef=".1 0 0 0 0"/>',
    "all at once": '<connect body1="c" body2="d" anchor=".1 0 .2"/><weld body1="f" body2="d"/><joint joint1="a2" joint2="c1"/>'
    '<tendon tendon1="t1"/>',
    "twice the same": '<connect body1="c" body2="d" anchor=".1 0 .2"/><joint joint1="a1" joint2="e1"/>'
    '<connect body1="c" body2="d" anchor=".1 0 .2"/>',
}


@pytest.mark.parametrize("h", [1e-3, 1e-2])
@pytest.mark.parametrize("kind", KINDS)
def test_one_step_is_numpys(kind, h):
    """Euler's rule from random states, with whatever error they have: M (v+ - v) = h f + J^T lambda with J v+ as demanded."""
    source = LINKAGE.format(equality=KINDS[kind])
    model, rng = mujoco.MjModel.from_xml_string(source), np.random.default_rng(3)
    sim = simulate(source, integrator="euler", timestep=h, stabilization="baumgarte")
    for _ in range(10):
        qpos, qvel = random_state(model, rng, speed=1.0)
        data = forward(model, qpos, qvel)
        sim.set_state(qpos, qvel)
        sim.step()
        mass = full_mass_matrix(model, data) + h * np.diag(model.dof_damping)
        free = qvel + h * np.linalg.solve(mass, data.qfrc_passive - data.qfrc_bias)
        rows, asked = equalities(model, data, mass, qvel, sim.options, midpoint=False)
        response = np.linalg.solve(mass, rows.T)
        expected = free + response @ np.linalg.solve(rows @ response, asked - rows @ free)
        scale = np.sqrt(expected @ mass @ expected)
        error = sim.qvel - expected
        # Rounding, times the condition of the rows in the metric of M (1e5 at the most here).
        assert np.sqrt(error @ mass @ error) < 1e-10 * scale
        assert sim.residual < 1e-10
        assert sim.status == stepper.Status.OK


@pytest.mark.parametrize("kind", KINDS)
def test_errors_go_to_zero_and_stay_there(kind):
    """From reset, where some are torn by a metre, in motion that dampers bring to rest."""
    source = LINKAGE.format(equality=KINDS[kind])
    model = mujoco.MjModel.from_xml_string(source)
    model.dof_damping[:] = 4.0
    model.opt.gravity[:] = 0
    for integrator in ("euler", "midpoint"):
        for stabilization in ("baumgarte", "split"):
            sim = simulate(model, integrator=integrator, stabilization=stabilization, timestep=5e-3)
            sim.set_state(qvel=np.random.default_rng(5).normal(scale=0.1, size=model.nv))
            sim.step(nstep=4000)
            rows = rows_of(model, forward(model, sim.qpos, sim.qvel))
            assert np.abs(rows.error).max() < 1e-9
            assert np.abs(sim.qvel).max() < 1e-6
