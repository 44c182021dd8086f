"""Quantities of bodies that tasks observe."""

import mujoco
import numpy as np
from models import mujoco_model
from stepper.envs import StepperVectorEnv


def test_a_moment_has_quantities_of_bodies():
    envs = StepperVectorEnv("Humanoid", 6)
    envs.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-0.4, 0.4, (5, *envs.action_space.shape)):
        envs.step(action)
    for name in ("xipos", "cinert", "cvel", "cfrc_ext"):
        np.testing.assert_array_equal(getattr(envs.now, name), getattr(envs.sim, name))
        assert getattr(envs.now, name) is getattr(envs.now, name)


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
    assert not envs.now.cfrc_ext.any()
    for _ in range(200):
        envs.step(np.zeros((3, 8)))
    total = envs.now.cfrc_ext.sum(axis=1)
    weight = 9.81 * envs.sim.model.body_mass.sum()
    np.testing.assert_allclose(total[:, 3:], [[0.0, 0.0, weight]] * 3, atol=0.02 * weight)
    # An arm of 0.1 m is some tenth of the robot.
    np.testing.assert_allclose(total[:, :3], 0.0, atol=0.02 * weight * 0.1)
