"""Contact forces on bodies are MuJoCo's of the same state."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, stepper_model

ENVS = 5


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
