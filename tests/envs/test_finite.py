"""Observations and rewards are finite: for actions that are not, for states that would not be, and for rewards of tasks that are not."""

from dataclasses import dataclass

import numpy as np
import pytest
from envs.cases import Strong
from stepper.envs import StepperEnv, StepperVectorEnv


@dataclass(frozen=True, kw_only=True)
class Logarithm(Strong):
    """A reward that is NaN or infinite for some positions."""

    def reward(self, now):
        with np.errstate(all="ignore"):
            return np.log(now.action[:, 0]), {}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_is_refused_and_nothing_is_stepped(bad):
    envs, env = StepperVectorEnv("HalfCheetah", 3), StepperEnv("HalfCheetah")
    envs.reset(seed=0), env.reset(seed=0)
    before, action = envs.sim.get_state(), np.zeros((3, 6))
    action[1:, 4] = bad
    with pytest.raises(ValueError, match=rf"environment 1 is {bad} in column 4 \(2 of 3 environments"):
        envs.step(action)
    assert envs.sim.get_state() == before
    assert not envs.episode_lengths.any()
    with pytest.raises(ValueError, match=rf"environment 0 is {bad} in column 4"):
        env.step(action[1])
    envs.step(np.zeros((3, 6)))


def test_actions_that_environments_ignore_may_be_anything():
    envs = StepperVectorEnv("HalfCheetah", 2, max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 6)))
    observation, reward, *_ = envs.step(np.full((2, 6), np.nan))
    assert np.isfinite(observation).all()
    assert not reward.any()
    assert not envs.now.action.any()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_an_environment_whose_state_would_not_be_finite_is_terminated(mode):
    envs = StepperVectorEnv(Strong(), 3, autoreset_mode=mode)
    envs.reset(seed=0)
    failing = np.array([False, True, False])
    observation, reward, terminated, _, info = envs.step(np.where(failing, 1e250, 0.0)[:, None])
    np.testing.assert_array_equal(terminated, failing)
    said = info["final_info"] if mode == "SameStep" else info
    np.testing.assert_array_equal(said["non_finite"], failing)
    assert np.isfinite(observation).all()
    np.testing.assert_array_equal(reward, [1.0, 0.0, 1.0])
    if mode == "Disabled":
        envs.reset(options={"reset_mask": failing})
    *_, terminated, _, info = envs.step(np.zeros((3, 1)))
    assert not terminated.any()
    assert "non_finite" not in info


def test_a_reward_that_is_not_finite_names_its_environment():
    envs = StepperVectorEnv(Logarithm(), 3)
    envs.reset(seed=0)
    said = r"reward of environment 1 is nan after the action \[-1\.0\]: return finite numbers from Logarithm\.reward"
    with pytest.raises(ValueError, match=said):
        envs.step(np.array([[1.0], [-1.0], [1.0]]))
    _, reward, *_ = envs.step(np.ones((3, 1)))
    assert not reward.any()
