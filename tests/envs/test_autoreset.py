"""When environments whose episode is over begin another: as in Gymnasium's `SyncVectorEnv` of single environments, bit for bit."""

import gymnasium
import numpy as np
import pytest
from envs.cases import same
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stepper.envs import StepperVectorEnv

N, LIMIT = 5, 18


def pair(mode):
    """A batch, and as many single environments."""

    def single():
        return gymnasium.make("stepper/Hopper-v5", max_episode_steps=LIMIT, disable_env_checker=True)

    ours = StepperVectorEnv("Hopper", N, autoreset_mode=mode, max_episode_steps=LIMIT)
    return ours, SyncVectorEnv([single] * N, autoreset_mode=mode)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_it_is_gymnasiums_for_episodes_that_fall_and_that_run_out(mode):
    """When disabled, whoever steps on is told, and a mask goes on. test_first_observations.py has all tasks, in short episodes."""
    ours, theirs = pair(mode)
    same(ours.reset(seed=3), theirs.reset(seed=3))
    rng, fell, ran_out = np.random.default_rng(0), 0, 0
    for _ in range(100):
        action = rng.uniform(-1, 1, ours.action_space.shape)
        found = ours.step(action)
        same(found, theirs.step(action))
        over = found[2] | found[3]
        fell, ran_out = fell + found[2].sum(), ran_out + found[3].sum()
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(ResetNeeded, match=rf"environments \[{np.flatnonzero(over)[0]}"):
                ours.step(action)
            same(ours.reset(options={"reset_mask": over}), theirs.reset(options={"reset_mask": over}))
    assert min(fell, ran_out) >= 3


def test_with_next_step_rewards_and_flags_of_a_reset_are_zero_and_its_action_ignored():
    envs = StepperVectorEnv("Hopper", 2, max_episode_steps=2)
    envs.reset(seed=0)
    zero, full = np.zeros((2, 3)), np.ones((2, 3))
    envs.step(zero)
    *_, truncated, info = envs.step(zero)
    assert truncated.all()
    assert "final_obs" not in info
    first, reward, terminated, truncated, info = envs.step(full * np.nan)
    assert not (reward.any() or terminated.any() or truncated.any())
    assert "x_velocity" not in info
    assert info["_x_position"].all()
    other = StepperVectorEnv("Hopper", 2)
    other.reset(seed=0)
    np.testing.assert_array_equal(first, other.reset()[0])


def test_final_observations_are_those_that_the_episode_ended_with():
    one = StepperVectorEnv("InvertedPendulum", 3, max_episode_steps=4, autoreset_mode="SameStep")
    other = StepperVectorEnv("InvertedPendulum", 3, max_episode_steps=4, autoreset_mode="Disabled")
    one.reset(seed=0), other.reset(seed=0)
    for _ in range(4):
        found, expected = one.step(np.zeros((3, 1))), other.step(np.zeros((3, 1)))
    np.testing.assert_array_equal(np.stack(list(found[-1]["final_obs"])), expected[0])
    np.testing.assert_array_equal(found[-1]["final_info"]["reward_survive"], expected[-1]["reward_survive"])
    np.testing.assert_array_equal(found[0], other.reset(options={"reset_mask": np.ones(3, bool)})[0])


def test_terminated_and_truncated_can_come_together_and_statistics_begin_anew():
    envs = StepperVectorEnv("Hopper", 4, autoreset_mode="SameStep", max_episode_steps=6, healthy_z_range=(2.0, 3.0))
    envs.reset(seed=0)
    _, _, terminated, truncated, _ = envs.step(np.zeros((4, 3)))
    assert terminated.all()
    assert not truncated.any()
    assert not envs.episode_lengths.any()
    assert not envs.episode_returns.any()


def test_statistics_of_an_episode_are_in_its_final_info():
    """With SAME_STEP, `final_info` has "episode" where an episode ended, with the length and the sum of rewards of that episode."""
    envs = StepperVectorEnv("HalfCheetah", 3, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=LIMIT, episode_statistics=True)
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(LIMIT):
        _, reward, _, truncated, info = envs.step(np.zeros(envs.action_space.shape))
        total += reward
    assert truncated.all()
    episode = info["final_info"]["episode"]
    np.testing.assert_array_equal(episode["l"], [LIMIT] * 3)
    np.testing.assert_allclose(episode["r"], total, rtol=1e-6)  # The sum has single precision.
