"""rsl_rl: values of the vector environment, time-outs and logs, and its runner with an asymmetric critic."""

import numpy as np
import pytest
import torch
from envs.test_hooks import Grouped
from rsl_rl.runners import OnPolicyRunner
from stepper.adapters.rsl_rl import StepperRslRlEnv
from stepper.envs import Reward, StepperVectorEnv

LIMIT = 6


class Rewarded(Grouped):
    """The slider with observation groups, whose reward has a term."""

    def rewards(self):
        return {"place": Reward(lambda now: now.qpos[:, 0], 2.0)}

    def reward(self, now):
        return now.reward_terms["place"]


def test_steps_have_the_values_of_the_vector_environment():
    env = StepperRslRlEnv(Rewarded(), 3, seed=4, max_episode_steps=LIMIT)
    envs = StepperVectorEnv(Rewarded(), 3, max_episode_steps=LIMIT, groups=True, dtype="float32", autoreset_mode="SAME_STEP")
    expected, _ = envs.reset(seed=4)
    assert (env.num_envs, env.num_actions, env.max_episode_length) == (3, 1, LIMIT)
    rng, total = np.random.default_rng(0), np.zeros(3)
    for k in range(2 * LIMIT):
        found = env.get_observations()
        assert found.keys() == {"policy", "critic"}
        for name, value in expected.items():
            np.testing.assert_array_equal(found[name].numpy(), value)
        np.testing.assert_array_equal(env.episode_length_buf.numpy(), envs.episode_lengths)
        actions = rng.uniform(-2.0, 2.0, (3, 1)).astype(np.float32)  # Half of them are clipped.
        expected, reward, _, truncated, infos = envs.step(np.clip(actions, -1.0, 1.0))
        _, rewards, dones, extras = env.step(torch.from_numpy(actions))
        total += reward
        np.testing.assert_array_equal(rewards.numpy(), reward.astype(np.float32))
        np.testing.assert_array_equal(extras["time_outs"].numpy(), truncated)
        np.testing.assert_array_equal(dones.numpy(), truncated)
        assert ("log" in extras) == (k % LIMIT == LIMIT - 1)
        if "log" in extras:
            assert extras["log"]["Episode_Reward/place"] == pytest.approx(infos["final_info"]["return_place"].mean(), rel=1e-12)
            assert extras["log"]["Episode_Reward/place"] == pytest.approx(total.mean(), rel=1e-12)
            total[:] = 0.0


def test_lengths_of_episodes_can_be_set():
    env = StepperRslRlEnv(Grouped(), 3, max_episode_steps=LIMIT)
    env.episode_length_buf = torch.tensor([0, LIMIT - 1, 2])
    *_, dones, _ = env.step(torch.zeros(3, 1))
    assert dones.tolist() == [0, 1, 0]
    env.reset()
    assert env.episode_length_buf.tolist() == [0, 0, 0]


def test_its_runner_trains_an_asymmetric_critic():
    env = StepperRslRlEnv("stepper/InvertedPendulum-v5", 8, seed=0)
    assert env.max_episode_length == 1000
    env = StepperRslRlEnv(Rewarded(), 16, seed=0, max_episode_steps=LIMIT)
    model = {"class_name": "rsl_rl.models.MLPModel", "hidden_dims": [16], "activation": "elu", "obs_normalization": True}
    config = {
        "num_steps_per_env": 8,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**model, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}},
        "critic": model,
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 2, "num_mini_batches": 2},
    }
    runner = OnPolicyRunner(env, config, log_dir=None, device="cpu")
    before = [parameter.clone() for parameter in runner.alg.critic.parameters()]
    runner.learn(2, init_at_random_ep_len=True)
    assert any(not torch.equal(a, b) for a, b in zip(before, runner.alg.critic.parameters(), strict=True))
    policy = runner.get_inference_policy()
    assert policy(env.get_observations()).shape == (16, 1)


def test_episodes_without_a_limit_are_an_error():
    with pytest.raises(ValueError, match="have no limit, which rsl_rl needs: give max_episode_steps"):
        StepperRslRlEnv(Grouped(), 2)
