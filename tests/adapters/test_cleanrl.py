"""CleanRL's script style: a PPO in one file, over Gymnasium's vector wrappers, with the native batch in place of `SyncVectorEnv`."""

import gymnasium as gym
import numpy as np
import pytest
import stepper.envs
import torch
from gymnasium.wrappers.vector import (
    ClipAction,
    DtypeObservation,
    NormalizeObservation,
    NormalizeReward,
    RecordEpisodeStatistics,
    TransformObservation,
    TransformReward,
)
from torch import nn
from torch.distributions.normal import Normal

NUM_ENVS, NUM_STEPS, ITERATIONS = 32, 64, 24
GAMMA, LAMBDA, CLIP = 0.98, 0.95, 0.2


def make_envs(name, **settings):
    """What `ppo_continuous_action.py` puts around each environment, around all of them."""
    envs = gym.make_vec(name, num_envs=NUM_ENVS, vectorization_mode="vector_entry_point", **settings)
    envs = ClipAction(RecordEpisodeStatistics(envs))
    envs = NormalizeObservation(envs)
    envs = TransformObservation(envs, lambda observation: np.clip(observation, -10, 10))
    envs = NormalizeReward(envs, gamma=GAMMA)
    envs = TransformReward(envs, lambda reward: np.clip(reward, -10, 10))
    return DtypeObservation(envs, np.float32)


def layer(inputs, outputs, gain=2**0.5):
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.constant_(made.bias, 0.0)
    return made


class Agent(nn.Module):
    def __init__(self, envs):
        super().__init__()
        inputs, outputs = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
        self.critic = nn.Sequential(layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, 1, 1.0))
        self.actor = nn.Sequential(layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, outputs, 0.01))
        self.logstd = nn.Parameter(torch.zeros(1, outputs))

    def act(self, observation, action=None):
        distribution = Normal(self.actor(observation), self.logstd.exp())
        action = distribution.sample() if action is None else action
        return action, distribution.log_prob(action).sum(1), self.critic(observation).flatten()


def train(envs, seed, iterations=ITERATIONS):
    """Returns of the episodes that ended in each iteration."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    agent = Agent(envs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=1e-3, eps=1e-5)
    shape = (NUM_STEPS, NUM_ENVS)
    obs, actions = torch.zeros(*shape, *envs.single_observation_space.shape), torch.zeros(*shape, *envs.single_action_space.shape)
    logprobs, rewards, dones, values = (torch.zeros(shape) for _ in range(4))
    next_obs, _ = envs.reset(seed=seed)
    next_obs, next_done, returns_of = torch.as_tensor(next_obs), torch.zeros(NUM_ENVS), []
    for _ in range(iterations):
        ended = []
        for t in range(NUM_STEPS):
            obs[t], dones[t] = next_obs, next_done
            with torch.no_grad():
                actions[t], logprobs[t], values[t] = agent.act(next_obs)
            said, reward, terminations, truncations, infos = envs.step(actions[t].numpy())
            rewards[t] = torch.as_tensor(reward)
            next_obs, next_done = torch.as_tensor(said), torch.as_tensor(terminations | truncations).float()
            if "episode" in infos:
                ended += infos["episode"]["r"][infos["_episode"]].tolist()
        returns_of.append(np.mean(ended) if ended else np.nan)
        with torch.no_grad():
            value, advantages, tail = agent.critic(next_obs).flatten(), torch.zeros(shape), 0.0
            for t in reversed(range(NUM_STEPS)):
                going_on = 1.0 - (next_done if t == NUM_STEPS - 1 else dones[t + 1])
                after = value if t == NUM_STEPS - 1 else values[t + 1]
                delta = rewards[t] + GAMMA * after * going_on - values[t]
                advantages[t] = tail = delta + GAMMA * LAMBDA * going_on * tail
        flat = [part.flatten(0, 1) for part in (obs, actions, logprobs, advantages, advantages + values)]
        for _ in range(6):
            # Without the step after each episode, whose action is ignored.
            kept = rng.permutation(np.flatnonzero(dones.flatten().numpy() == 0))
            for rows in np.split(kept, range(256, len(kept), 256)):
                observation, action, before, advantage, target = (part[rows] for part in flat)
                _, logprob, value = agent.act(observation, action)
                ratio = (logprob - before).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                loss = (
                    -torch.min(advantage * ratio, advantage * ratio.clamp(1 - CLIP, 1 + CLIP)).mean() + 0.5 * ((value - target) ** 2).mean()
                )
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
    return returns_of


@pytest.mark.parametrize("name", ["stepper/InvertedPendulum-v5"])
def test_a_script_in_its_style_learns(name):
    assert name.removeprefix("stepper/").removesuffix("-v5") in stepper.envs.TASKS
    returns = train(make_envs(name, max_episode_steps=200, precision="f32"), seed=1)
    assert returns[0] < 30
    assert np.nanmax(returns) > 150  # of 200


def test_the_same_seed_learns_the_same():
    """To the bit, with several threads."""
    settings = {"name": "stepper/InvertedPendulum-v5", "max_episode_steps": 50}
    first, second = (train(make_envs(**settings, threads=threads), 3, iterations=5) for threads in (1, 2))
    assert first == second
