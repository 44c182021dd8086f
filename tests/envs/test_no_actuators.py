"""A task whose model has no actuators warns: its actions have size 0."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
import stepper
from loading_scenes import arm
from stepper.envs import Observation, StepperVectorEnv, Task


@dataclass(frozen=True)
class Arm(Task):
    """An arm from a URDF."""

    actuators_of_joints: str | None = None
    frame_skip: int = 1

    def model(self):
        return stepper.load(arm(), actuators=self.actuators_of_joints)

    def observations(self):
        return (Observation("qpos"),)

    def reward(self, now):
        return np.zeros(now.sim.num_envs or 1), {}


def test_a_urdf_without_actuators_warns_with_the_remedy():
    with pytest.warns(
        stepper.ModelWarning, match=r'Arm: the model "r" has no actuators, .* stepper\.load\(\.\.\., actuators="position"\)'
    ) as caught:
        envs = StepperVectorEnv(Arm(), 2)
    assert envs.single_action_space.shape == (0,)
    assert caught[0].filename == __file__


def test_one_with_actuators_does_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = StepperVectorEnv(Arm("position"), 2)
    assert envs.single_action_space.low.tolist() == [-1, -1]
    assert envs.single_action_space.high.tolist() == [2, 2]


def test_a_task_with_actions_of_its_own_does_not():
    class Moved(Arm):
        def action_bounds(self, model):
            return np.full(1, -1.0), np.full(1, 1.0)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        StepperVectorEnv(Moved(), 2)
