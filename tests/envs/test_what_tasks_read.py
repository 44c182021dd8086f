"""Quantities of bodies that humanoids observe are MuJoCo's of the same state."""

import mujoco
import numpy as np
import pytest
from models import mujoco_model
from stepper.envs import StepperVectorEnv, contact_wrenches, inertias, mass_centers, velocities


@pytest.mark.parametrize(("name", "file"), [("Humanoid", "humanoid"), ("Ant", "ant")])
@pytest.mark.parametrize(("precision", "near"), [("f64", 1e-12), ("f32", 1e-4)])
def test_inertias_and_velocities(name, file, precision, near):
    envs = StepperVectorEnv(name, 6, precision=precision)
    envs.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, *envs.action_space.shape)):
        envs.step(action)
    model = mujoco_model(f"gymnasium/{file}")
    data = mujoco.MjData(model)
    for env in range(6):
        data.qpos, data.qvel = envs.sim.qpos[env], envs.sim.qvel[env]
        mujoco.mj_forward(model, data)
        # Sums of a few numbers of at most the size that stands here, in either precision.
        for found, expected in [(inertias, data.cinert), (velocities, data.cvel), (mass_centers, data.xipos)]:
            scale = 1.0 + np.abs(expected).max()
            np.testing.assert_allclose(found(envs.now)[env, 1:], expected[1:], atol=near * scale)


def test_tendons_are_mujocos():
    envs = StepperVectorEnv("Humanoid", 2)
    _, info = envs.reset(seed=0)
    model = mujoco_model("gymnasium/humanoid")
    data = mujoco.MjData(model)
    data.qpos, data.qvel = envs.sim.qpos[1], envs.sim.qvel[1]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(info["tendon_length"][1], data.ten_length, atol=1e-15)
    np.testing.assert_allclose(info["tendon_velocity"][1], data.ten_velocity, atol=1e-15)


def test_wrenches_of_contacts_carry_the_robot():
    """What lies still is carried: forces add to the weight, and torques about the centre of mass to none."""
    envs = StepperVectorEnv("Ant", 3, contact="hard", terminate_when_unhealthy=False)
    envs.reset(seed=0)
    assert not contact_wrenches(envs.now).any()
    for _ in range(200):
        envs.step(np.zeros((3, 8)))
    total = contact_wrenches(envs.now).sum(axis=1)
    weight = 9.81 * envs.sim.model.body_mass.sum()
    np.testing.assert_allclose(total[:, 3:], [[0.0, 0.0, weight]] * 3, atol=0.02 * weight)
    # An arm of 0.1 m is some tenth of the robot.
    np.testing.assert_allclose(total[:, :3], 0.0, atol=0.02 * weight * 0.1)
