"""PPO in one file in the style of CleanRL, with a vector environment of stepper in place of `SyncVectorEnv`. Copy the file and change it.

    pip install 'stepper-sim[train]'
    python examples/train_cleanrl.py stepper/HalfCheetah-v5 --seed 1

Gymnasium's vector wrappers normalise observations and rewards, as CleanRL's scripts for continuous actions do with single environments.
The script writes a learning curve, and a policy that `stepper evaluate` and `stepper.policies` run without PyTorch.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path
from typing import Any, NamedTuple

# Idle OpenMP threads spin by default, which takes processor time from the physics. The variable must be set before PyTorch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
import gymnasium as gym
import numpy as np
import stepper.envs
import torch
from gymnasium.wrappers import vector
from stepper.policies import Policy, describe, evaluate
from torch import Tensor, nn
from torch.distributions.normal import Normal

CLIP_OBSERVATION = 10.0
"""Largest absolute value of normalised observations and rewards."""
FRESH = 2**32
"""First seed of evaluation episodes, which no training uses."""


class Settings(NamedTuple):
    """Settings of the learner, for many environments and short rollouts.

    Attributes:
        num_envs: Number of environments.
        num_steps: Steps of each environment per rollout.
        epochs: Passes over the samples of a rollout.
        minibatch: Samples per gradient step.
        learning_rate: Initial learning rate of Adam, which falls to 0.
        gamma: Discount factor per step.
        gae_lambda: Decay factor of generalised advantage estimation.
        clip: Deviation of the probability ratio from 1 at which the objective is clipped.
        value: Weight of the loss of the critic.
        entropy: Weight of the entropy bonus.
        max_grad_norm: Largest norm of the gradient.
    """

    num_envs: int = 64
    num_steps: int = 64
    epochs: int = 8
    minibatch: int = 512
    learning_rate: float = 1e-3
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    value: float = 0.5
    entropy: float = 0.0
    max_grad_norm: float = 0.5


class Wrapped(NamedTuple):
    """Wrapped vector environment, and its wrapper that has the mean and the variance of the observations."""

    envs: Any
    normalized: vector.NormalizeObservation


def make_envs(env: str, num_envs: int, gamma: float, **settings: Any) -> Wrapped:
    """Vector environment with CleanRL's wrappers: one batch, in the autoreset mode NEXT_STEP."""
    envs = gym.make_vec(env, num_envs=num_envs, vectorization_mode="vector_entry_point", **settings)
    envs = vector.ClipAction(vector.RecordEpisodeStatistics(envs))
    normalized = vector.NormalizeObservation(envs)
    envs = vector.TransformObservation(normalized, lambda observation: np.clip(observation, -CLIP_OBSERVATION, CLIP_OBSERVATION))
    envs = vector.TransformReward(
        vector.NormalizeReward(envs, gamma=gamma), lambda reward: np.clip(reward, -CLIP_OBSERVATION, CLIP_OBSERVATION)
    )
    return Wrapped(vector.DtypeObservation(envs, np.float32), normalized)


def layer(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    """Linear layer with orthogonal weights."""
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.constant_(made.bias, 0.0)
    return made


class Agent(nn.Module):
    """Actor and critic with two hidden layers of 64 units each. The standard deviation of the actions does not depend on the state."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.critic = nn.Sequential(layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, 1, 1.0))
        self.actor = nn.Sequential(layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, outputs, 0.01))
        self.log_std = nn.Parameter(torch.zeros(1, outputs))

    def act(self, observation: Tensor, action: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Sampled or given actions (n, nu), their log probabilities and entropies (n,), and values of the states (n,)."""
        distribution = Normal(self.actor(observation), self.log_std.exp())
        action = distribution.sample() if action is None else action
        return action, distribution.log_prob(action).sum(1), distribution.entropy().sum(1), self.critic(observation).flatten()


def train(wrapped: Wrapped, seed: int, iterations: int, settings: Settings, curve: Path | None = None) -> tuple[Agent, list[float]]:
    """Train an agent.

    Args:
        wrapped: Result of `make_envs`.
        seed: Seed of all random numbers.
        iterations: Number of rollouts, each with an update.
        settings: Settings of the learner.
        curve: CSV file for the learning curve. With None no file is written.

    Returns:
        The agent, and the mean return of the episodes that ended in each rollout, NaN if none ended.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    s, envs = settings, wrapped.envs
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimizer = torch.optim.Adam(agent.parameters(), lr=s.learning_rate, eps=1e-5)

    shape = (s.num_steps, s.num_envs)
    obs = torch.zeros(*shape, *envs.single_observation_space.shape)
    actions = torch.zeros(*shape, *envs.single_action_space.shape)
    logprobs, rewards, dones, values = (torch.zeros(shape) for _ in range(4))
    next_obs, next_done = torch.as_tensor(envs.reset(seed=stepper.envs.seeds(seed, s.num_envs))[0]), torch.zeros(s.num_envs)
    means: list[float] = []
    begun = time.process_time()
    for iteration in range(iterations):
        optimizer.param_groups[0]["lr"] = s.learning_rate * (1.0 - iteration / iterations)

        ended: list[float] = []
        for t in range(s.num_steps):
            obs[t], dones[t] = next_obs, next_done
            with torch.no_grad():
                actions[t], logprobs[t], _, values[t] = agent.act(next_obs)
            observation, reward, terminations, truncations, infos = envs.step(actions[t].numpy())
            rewards[t] = torch.as_tensor(reward)
            next_obs, next_done = torch.as_tensor(observation), torch.as_tensor(terminations | truncations).float()
            if "episode" in infos:
                ended += infos["episode"]["r"][infos["_episode"]].tolist()
        means.append(float(np.mean(ended)) if ended else float("nan"))

        with torch.no_grad():
            next_value = agent.critic(next_obs).flatten()
        advantages, tail = torch.zeros(shape), torch.zeros(s.num_envs)
        for t in reversed(range(s.num_steps)):
            going_on = 1.0 - (next_done if t == s.num_steps - 1 else dones[t + 1])
            after = next_value if t == s.num_steps - 1 else values[t + 1]
            delta = rewards[t] + s.gamma * after * going_on - values[t]
            advantages[t] = tail = delta + s.gamma * s.gae_lambda * going_on * tail

        flat = [part.flatten(0, 1) for part in (obs, actions, logprobs, advantages, advantages + values)]
        # With NEXT_STEP, the step after the end of an episode ignores its action. It is therefore not used as a sample.
        samples = np.flatnonzero(dones.flatten().numpy() == 0)
        for _ in range(s.epochs):
            mixed = rng.permutation(samples)
            for rows in np.split(mixed, range(s.minibatch, len(mixed), s.minibatch)):
                b_obs, b_actions, b_logprobs, b_advantages, b_returns = (part[rows] for part in flat)
                _, logprob, entropy, value = agent.act(b_obs, b_actions)
                ratio = (logprob - b_logprobs).exp()
                b_advantages = (b_advantages - b_advantages.mean()) / (b_advantages.std(correction=0) + 1e-8)
                actor_loss = -torch.min(b_advantages * ratio, b_advantages * ratio.clamp(1.0 - s.clip, 1.0 + s.clip)).mean()
                loss = actor_loss + s.value * (value - b_returns).square().mean() - s.entropy * entropy.mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), s.max_grad_norm)
                optimizer.step()

        steps = (iteration + 1) * s.num_envs * s.num_steps
        if curve is not None:
            with curve.open("a", newline="") as file:
                csv.writer(file).writerow([steps, round(time.process_time() - begun, 2), means[-1]])
            if ended:
                print(f"{steps:>12,} steps {time.process_time() - begun:6.0f} s  return {means[-1]:9.1f}", flush=True)
    return agent, means


def policy_of(agent: Agent, wrapped: Wrapped, training: dict[str, Any]) -> Policy:
    """Learned policy for NumPy: the mean of the actions, with the normalisation of the observations.

    Args:
        agent: The trained agent.
        wrapped: Result of `make_envs` in which it was trained.
        training: Entries for the field `training` of the policy.
    """
    space = wrapped.envs.unwrapped.single_action_space  # The action space of the wrapper ClipAction has no bounds.
    middle, half = (space.high + space.low) / 2.0, (space.high - space.low) / 2.0
    linear = [part for part in agent.actor if isinstance(part, nn.Linear)]
    layers = [(part.weight.detach().numpy().T.copy(), part.bias.detach().numpy().copy()) for part in linear]
    # The agent's actions are in units of the task; a `Policy` has outputs from -1 to 1 and scales them to the bounds.
    weight, bias = layers[-1]
    layers[-1] = (weight / half, (bias - middle) / half)
    moments = wrapped.normalized.obs_rms
    return Policy(
        mean=moments.mean,
        std=np.sqrt(moments.var + wrapped.normalized.epsilon),
        clip=CLIP_OBSERVATION,
        layers=tuple(layers),
        activation="tanh",
        low=np.asarray(space.low, dtype=np.float64),
        high=np.asarray(space.high, dtype=np.float64),
        environment=describe(wrapped.envs),
        training={**training, "learner": "train_cleanrl.py", "torch": torch.__version__},
    )


def main() -> None:
    """Train and evaluate a policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env", nargs="?", default="stepper/HalfCheetah-v5", help="name of the environment [stepper/HalfCheetah-v5]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=2_000_000, help="number of environment steps in all [2000000]")
    parser.add_argument("--num-envs", type=int, default=Settings().num_envs, help=f"number of environments [{Settings().num_envs}]")
    parser.add_argument("--out", type=Path, help="folder for the results [out/train_cleanrl/ENV/seedN]")
    given = parser.parse_args()
    torch.set_num_threads(1)
    folder = given.out or Path("out/train_cleanrl", given.env.replace("/", "_"), f"seed{given.seed}")
    folder.mkdir(parents=True, exist_ok=True)
    curve = folder / "curve.csv"
    curve.write_text("steps,processor,return\n")

    settings = Settings(num_envs=given.num_envs)
    wrapped = make_envs(given.env, settings.num_envs, settings.gamma, precision="f32")
    iterations = max(given.steps // (settings.num_envs * settings.num_steps), 1)
    agent, _ = train(wrapped, given.seed, iterations, settings, curve)
    policy = policy_of(agent, wrapped, {"env": given.env, "seed": given.seed, "steps": given.steps})
    policy.save(folder / "policy.npz")
    print(f"wrote {folder}")
    print(evaluate(policy, given.env, episodes=20, seed=FRESH, precision="f32"))


if __name__ == "__main__":
    main()
