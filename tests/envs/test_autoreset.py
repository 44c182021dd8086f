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


def test_statistics_of_an_episode_are_in_its_final_info():
    """With SAME_STEP, `final_info` has "episode" where an episode ended, with the length and the sum of rewards of that episode."""
    envs = StepperVectorEnv("HalfCheetah", 3, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=LIMIT, episode_statistics=True)
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(LIMIT):
        _, reward, _, truncated, info = envs.step(np.zeros(envs.action_space.shape))
        total += reward
    assert truncated.all()
    assert not (envs.episode_lengths.any() or envs.episode_returns.any())  # Those of the next episode.
    episode = info["final_info"]["episode"]
    np.testing.assert_array_equal(episode["l"], [LIMIT] * 3)
    np.testing.assert_allclose(episode["r"], total, rtol=1e-6)  # The sum has single precision.
