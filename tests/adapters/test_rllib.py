"""RLlib's new API stack: its env runner makes the native batch, and PPO learns with it."""

import numpy as np
import pytest
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from stepper.adapters.rllib import register_env
from stepper.envs import StepperVectorEnv
from stepper.envs.tasks.running import Hopper


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def config(name, num_envs, **runners):
    return (
        PPOConfig()
        .environment(name, env_config={"max_episode_steps": 30})
        .env_runners(gym_env_vectorize_mode="vector_entry_point", num_envs_per_env_runner=num_envs, num_env_runners=0, **runners)
    )


@pytest.mark.parametrize("env", ["stepper/Hopper-v5", Hopper])
def test_its_env_runner_makes_the_native_batch_and_samples_it(env):
    register_env("hopper", env, precision="f32")
    runner = SingleAgentEnvRunner(config=config("hopper", 8))
    assert isinstance(runner.env.unwrapped, StepperVectorEnv)
    episodes = runner.sample(num_timesteps=400, random_actions=True)
    assert sum(len(episode) for episode in episodes) >= 400
    ended = [episode for episode in episodes if episode.is_done]
    assert len(ended) > 5
    for episode in episodes:
        observations = np.array(episode.get_observations())
        assert observations.dtype == np.float32
        assert len(observations) == len(episode) + 1 <= 31
        # The task's reward is 1 for each healthy step, and what the hopper gains and spends: it is that of no step after the end.
        assert np.isfinite(episode.get_rewards()).all()
        assert all("x_position" in info for info in episode.get_infos())
    runner.stop()


def test_episodes_of_its_runner_follow_the_bits_of_the_vector_environment():
    register_env("hopper", "stepper/Hopper-v5")
    runner = SingleAgentEnvRunner(config=config("hopper", 4))
    runner.env.reset(seed=5)
    envs = StepperVectorEnv("Hopper", 4, dtype="float32", max_episode_steps=30)
    envs.reset(seed=5)
    draws = np.random.default_rng(0)
    for _ in range(40):
        action = draws.uniform(-1, 1, (4, 3))
        for found, expected in zip(runner.env.step(action)[:4], envs.step(action)[:4], strict=True):
            np.testing.assert_array_equal(found, expected)
    runner.stop()


def test_ppo_learns_to_balance_a_pole_on_an_env_runner_of_its_own():
    register_env("pole", "stepper/InvertedPendulum-v5", precision="f32", max_episode_steps=200)
    ppo = (
        PPOConfig()
        .environment("pole")
        .env_runners(num_env_runners=1, num_envs_per_env_runner=32, gym_env_vectorize_mode="vector_entry_point", rollout_fragment_length=64)
        .training(train_batch_size_per_learner=2048, minibatch_size=256, num_epochs=6, lr=1e-3, gamma=0.98)
        .debugging(seed=0)
        .build_algo()
    )
    returns = [ppo.train()["env_runners"]["episode_return_mean"] for _ in range(14)]
    ppo.stop()
    assert returns[0] < 40
    assert max(returns) > 4 * returns[0]
