"""TorchRL: its check of specs, partial resets, its collector, and a rollout with the bits of the vector environment."""

import numpy as np
import pytest
import torch
from checks import every, raises
from envs.test_hooks import Grouped
from stepper.adapters.torchrl import StepperTorchRLEnv
from stepper.envs import StepperVectorEnv
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import RewardSum, StepCounter, TransformedEnv, check_env_specs

NUM_ENVS = 4


@every(name=["Hopper", "Ant", "Reacher"], break_when_any_done=[True, False])
def test_its_check_of_specs_passes(name, break_when_any_done):
    env = StepperTorchRLEnv(f"stepper/{name}-v5", NUM_ENVS, max_episode_steps=2)
    check_env_specs(env, break_when_any_done=break_when_any_done, seed=0)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_rollout_has_the_bits_of_the_vector_environment(precision):
    env = StepperTorchRLEnv("stepper/Hopper-v5", NUM_ENVS, max_episode_steps=7, precision=precision)
    env.set_seed(3)
    torch.manual_seed(0)
    rollout = env.rollout(20, break_when_any_done=False)
    assert rollout.shape == (NUM_ENVS, 20)
    envs = StepperVectorEnv("Hopper", NUM_ENVS, max_episode_steps=7, precision=precision, dtype="float32", autoreset_mode="SameStep")
    observation, _ = envs.reset(seed=3)
    assert rollout["next", "done"].sum() >= 2 * NUM_ENVS
    for t in range(20):
        np.testing.assert_array_equal(rollout["observation"][:, t], observation)
        observation, reward, terminated, truncated, infos = envs.step(rollout["action"][:, t].numpy())
        np.testing.assert_array_equal(rollout["next", "reward"][:, t, 0], reward.astype(np.float32))
        np.testing.assert_array_equal(rollout["next", "terminated"][:, t, 0], terminated)
        np.testing.assert_array_equal(rollout["next", "truncated"][:, t, 0], truncated)
        for k in range(NUM_ENVS):
            over = terminated[k] or truncated[k]
            np.testing.assert_array_equal(rollout["next", "observation"][k, t], infos["final_obs"][k] if over else observation[k])


def test_an_environment_whose_episode_is_over_waits_for_the_others():
    """What `break_when_all_done` asks for: steps of some, the others as they were."""
    env = StepperTorchRLEnv("stepper/Hopper-v5", NUM_ENVS)
    env.set_seed(0)
    torch.manual_seed(1)
    rollout = env.rollout(1000, break_when_all_done=True, break_when_any_done=False)
    done = rollout["next", "done"][..., 0]
    lengths = done.float().argmax(dim=1)
    assert len(set(lengths.tolist())) > 1
    for k, first in enumerate(lengths.tolist()):
        assert done[k, first:].all()
        last = rollout["next", "observation"][k, first:]
        assert (last == last[0]).all()


def test_a_step_of_an_episode_that_is_over_is_named():
    env = StepperTorchRLEnv("stepper/Hopper-v5", NUM_ENVS, max_episode_steps=1)
    state = env.rand_step(env.reset())
    raises(RuntimeError, "have ended: reset them", lambda: env.step(env.rand_action(state["next"])))
    state = env.reset()
    state["_step"] = torch.tensor([[True], [True], [False], [True]])
    raises(RuntimeError, r"excludes the environments \[2\], whose episodes have not ended", lambda: env.step(env.rand_action(state)))


def test_its_collector_and_transforms_take_it():
    env = TransformedEnv(StepperTorchRLEnv("stepper/InvertedPendulum-v5", 16, max_episode_steps=50))
    env.append_transform(RewardSum())
    env.append_transform(StepCounter())
    policy = TensorDictModule(torch.nn.Linear(4, 1), in_keys=["observation"], out_keys=["action"])
    frames = {"frames_per_batch": 16 * 60, "total_frames": 16 * 120}
    collector = Collector(env, policy, auto_register_policy_transforms=True, **frames)
    batches = list(collector)
    collector.shutdown()
    assert [batch.shape for batch in batches] == [(16, 60)] * 2
    for batch in batches:
        done = batch["next", "done"]
        assert done.any()
        # A reward of one for each step.
        assert (batch["next", "episode_reward"][done] >= batch["next", "step_count"][done] - 1).all()


def test_a_policy_gradient_learns_to_balance():
    """REINFORCE with a mean baseline, on rollouts of TorchRL: the pole stays up for longer."""
    torch.manual_seed(0)
    env = StepperTorchRLEnv("stepper/InvertedPendulum-v5", 128, max_episode_steps=60, precision="f32")
    env.set_seed(0)
    mean = torch.nn.Sequential(torch.nn.Linear(4, 32), torch.nn.Tanh(), torch.nn.Linear(32, 1))
    optimizer = torch.optim.Adam(mean.parameters(), lr=1e-2)

    def act(observation):
        return torch.clamp(mean(observation) + 0.3 * torch.randn(128, 1), -3, 3)

    policy = TensorDictModule(act, in_keys=["observation"], out_keys=["action"])
    lengths = []
    for _ in range(60):
        with torch.no_grad():
            rollout = env.rollout(60, policy, break_when_any_done=False)
        reward, done = rollout["next", "reward"], rollout["next", "done"]
        returns, tail = torch.zeros_like(reward), torch.zeros(128, 1)
        for t in reversed(range(60)):
            tail = reward[:, t] + 0.95 * tail * ~done[:, t]
            returns[:, t] = tail
        lengths.append(128 * 60 / max(1, int(done.sum())))
        advantage = (returns - returns.mean()) / returns.std()
        log_probability = -((rollout["action"] - mean(rollout["observation"])) ** 2) / (2 * 0.3**2)
        loss = -(log_probability * advantage).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert lengths[0] < 20
    assert lengths[-1] > 2 * lengths[0]


def test_observation_groups_are_entries():
    env = StepperTorchRLEnv(Grouped(), NUM_ENVS, max_episode_steps=5, groups=True)
    check_env_specs(env, seed=0)
    env.set_seed(3)
    rollout = env.rollout(8, break_when_any_done=False)
    envs = StepperVectorEnv(Grouped(), NUM_ENVS, max_episode_steps=5, groups=True, dtype="float32", autoreset_mode="SAME_STEP")
    observation, _ = envs.reset(seed=3)
    assert "observation" not in rollout
    for t in range(8):
        for name in ("policy", "critic"):
            np.testing.assert_array_equal(rollout[name][:, t], observation[name])
        observation, *_ = envs.step(rollout["action"][:, t].numpy())
