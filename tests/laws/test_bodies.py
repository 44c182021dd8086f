"""Inertias, velocities and contact forces of bodies are MuJoCo's of the same state."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, mujoco_model, random_state, stepper_model

ENVS = 5
ROBOTS = ["gymnasium/humanoid", "gymnasium/ant", "gymnasium/pusher_v5", "dm_control/quadruped", "dm_control/manipulator"]
"""The last two and the pusher have several trees."""
MOCAP = """
<mujoco><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"><inertial pos="0 .1 0" mass="2" diaginertia=".1 .2 .25" euler="10 20 30"/>
    <body name="finger" pos="0 0 .2"><joint name="finger" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/></body>
  </body>
  <body pos="1 0 0"><geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""


def batch(name, **settings):
    """Random states of a robot, and its model in MuJoCo."""
    if name == "mocap":
        source, model = mujoco.MjModel.from_xml_string(MOCAP), stepper.load(MOCAP)
    else:
        source, model = mujoco_model(name), stepper_model(name, strict=False)
    sim = stepper.Stepper(model, ENVS, **settings)
    rng = np.random.default_rng(3)
    states = [random_state(source, rng, 1.0) for _ in range(ENVS)]
    sim.set_state(*(np.array(part) for part in zip(*states, strict=True)))
    return sim, source


def forward(source, sim, env):
    data = mujoco.MjData(source)
    data.qpos, data.qvel = sim.qpos[env], sim.qvel[env]
    mujoco.mj_forward(source, data)
    return data


@pytest.mark.parametrize("name", [*ROBOTS, "mocap"])
@pytest.mark.parametrize(("precision", "near"), [("f64", 1e-12), ("f32", 1e-4)])
def test_inertias_and_velocities(name, precision, near):
    sim, source = batch(name, precision=precision)
    for env in range(ENVS):
        data = forward(source, sim, env)
        # Sums of a few numbers of at most the size that stands here, in either precision.
        for quantity in ("cinert", "cvel", "xipos"):
            found, expected = getattr(sim, quantity), getattr(data, quantity)
            assert found.dtype == (np.float32 if precision == "f32" else np.float64)
            np.testing.assert_allclose(found[env], expected, atol=near * (1.0 + np.abs(expected).max()), err_msg=quantity)


@pytest.mark.parametrize(("name", "low"), [("gymnasium/humanoid", 0.05), ("gymnasium/ant", 0.05), ("dm_control/humanoid", 0.05)])
def test_forces_of_contacts(name, low):
    """By MuJoCo's law and Euler's method, from the same states: forces and torques are the same to round-off of the two solvers."""
    model = stepper_model(name, strict=False)
    options = stepper.Options(contact="mujoco", integrator="euler", tolerance=1e-12, iterations=200, timestep=1e-4)
    sim = stepper.Stepper(model, ENVS, options=options)
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    source.opt.timestep, source.opt.solver, source.opt.tolerance, source.opt.iterations = 1e-4, mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200
    source.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    lowest = np.array(sim.qpos)
    lowest[:, 2] = np.linspace(low, low + 0.25, ENVS)
    rng = np.random.default_rng(0)
    sim.set_state(lowest, rng.normal(0.0, 0.5, (ENVS, model.nv)))
    pull = rng.normal(0.0, 3.0, (ENVS, model.nbody, 6))
    pull[:, 0] = 0.0
    seen = 0
    for env in range(ENVS):
        data = mujoco.MjData(source)
        data.qpos, data.qvel, data.xfrc_applied = sim.qpos[env], sim.qvel[env], pull[env]
        mujoco.mj_forward(source, data)
        mujoco.mj_rnePostConstraint(source, data)
        alone = stepper.Stepper(model, options=options)
        alone.set_state(sim.qpos[env], sim.qvel[env])
        alone.xfrc_applied[...] = pull[env]
        assert not alone.cfrc_ext.any()
        alone.step()
        found = alone.cfrc_ext
        expected = np.array(data.cfrc_ext)
        expected[:, 3:] -= pull[env, :, :3]
        arm = data.xipos - data.subtree_com[source.body_rootid]
        expected[:, :3] -= pull[env, :, 3:] + np.cross(arm, pull[env, :, :3])
        # The reference point moves with the step.
        moved = data.subtree_com[source.body_rootid] - alone.subtree_com[source.body_rootid]
        expected[:, :3] += np.cross(moved, expected[:, 3:])
        scale = 1.0 + np.abs(expected).max()
        np.testing.assert_allclose(found, expected, atol=1e-9 * scale)
        seen += scale > 10.0
    assert seen >= 2


def test_parameters_of_environments_count():
    sim, source = batch("gymnasium/humanoid")
    rng = np.random.default_rng(1)
    masses = source.body_mass * rng.uniform(0.5, 2.0, (ENVS, source.nbody))
    moments = source.body_inertia * rng.uniform(0.9, 1.1, (ENVS, source.nbody, 1))
    places = source.body_ipos + rng.uniform(-0.05, 0.05, (ENVS, source.nbody, 3))
    places[:, 0] = 0.0
    sim.randomize(body_mass=masses, body_inertia=moments, body_ipos=places)
    for env in range(ENVS):
        own = mujoco.MjModel.from_xml_path(str(SOURCES["gymnasium/humanoid"]))
        own.body_mass[:], own.body_inertia[:], own.body_ipos[:] = masses[env], moments[env], places[env]
        mujoco.mj_setConst(own, mujoco.MjData(own))
        data = forward(own, sim, env)
        for quantity in ("cinert", "cvel", "xipos"):
            expected = getattr(data, quantity)
            np.testing.assert_allclose(getattr(sim, quantity)[env], expected, atol=1e-12 * (1.0 + np.abs(expected).max()))
