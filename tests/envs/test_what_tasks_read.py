"""Forces of contacts that tasks observe."""

import numpy as np
from stepper.envs import StepperVectorEnv


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
