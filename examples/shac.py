"""Short-horizon actor-critic (SHAC) in one file: policy learning by derivatives of the simulation.

    python examples/shac.py stepper/HalfCheetah-v5 --minutes 5
    python examples/shac.py stepper/Swimmer-v5 --minutes 5

The policy acts for a horizon in all environments. All its steps are then linearized as one batch. The gradient of the rewards propagates
back through these matrices to the weights of the policy. A value network, trained on the same steps, estimates the return beyond the
horizon (Xu et al. 2022, "Accelerated Policy Learning with Parallel Differentiable Simulation",
https://arxiv.org/abs/2204.07137).

`Stepper.linearize` computes the matrices (docs/how-to/derivatives.md). Only the observation and the reward of a task must also exist as
PyTorch functions. The first update compares the results of these functions with those of the task.

`--minutes` is processor time. The script writes the learning curve during the training, and the policy at the end.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stepper
import stepper.envs
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stepper.policies import Policy, describe, evaluate
from stepper.policies.ppo import EVALUATION_SEED, ActorCritic, Moments
from stepper.policies.ppo_settings import Settings
from torch import Tensor, nn

Array = NDArray[Any]


@dataclass(frozen=True)
class Differentiable:
    """Observation and reward of a task as functions of PyTorch tensors, so that gradients flow through them.

    Attributes:
        observation: Function from qpos (n, nq) and qvel (n, nv) to observations.
        reward: Function that returns rewards (n,) from five arguments: qpos before the action, qpos and qvel after it, the action, and its
            duration in s.
    """

    observation: Callable[[Tensor, Tensor], Tensor]
    reward: Callable[[Tensor, Tensor, Tensor, Tensor, float], Tensor]


def forward(hidden: int, weight: float) -> Differentiable:
    """Observation and reward of Gymnasium's running robots: the reward is the speed in x less `weight` times the squared action.

    The first `hidden` coordinates of qpos are not observed.
    """
    return Differentiable(
        observation=lambda qpos, qvel: torch.cat([qpos[:, hidden:], qvel], dim=1),
        reward=lambda qpos, after, qvel, action, dt: (after[:, 0] - qpos[:, 0]) / dt - weight * action.square().sum(dim=1),
    )


TASKS = {"stepper/HalfCheetah-v5": forward(1, 0.1), "stepper/Swimmer-v5": forward(2, 1e-4)}


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Hyperparameters of the training.

    Attributes:
        num_envs: Number of environments.
        horizon: Number of consecutive actions through which a gradient propagates. Episodes are a whole number of horizons.
        rate: Initial learning rate of the policy. It decreases linearly to a tenth.
        critic_rate: Learning rate of the value network.
        epochs: Passes of the value network over the samples of a horizon.
        gamma: Discount factor.
        trace: Parameter lambda of TD(lambda), for the targets of the value network.
        follow: Weight of the old parameters in each update of the target network.
        std: Initial standard deviation of the actions, as a fraction of half their range.
        bound: Bound of the gradient norm.
        beyond: Weight of the penalty on actions beyond their range.
        threads: Number of threads of the physics and of PyTorch.
        seed: Seed of all random numbers.
    """

    num_envs: int = 32
    horizon: int = 25
    rate: float = 2e-3
    critic_rate: float = 2e-3
    epochs: int = 4
    gamma: float = 0.99
    trace: float = 0.95
    follow: float = 0.2
    std: float = 0.4
    bound: float = 1.0
    beyond: float = 0.1
    threads: int = 1
    seed: int = 1


@dataclass
class Horizon:
    """Samples of a horizon of T actions in n environments.

    Attributes:
        states: Values of qpos and qvel before each action and at the end, (T + 1, n, 2 nv).
        actions: Actions, (T, n, nu).
        rewards: Rewards, (T, n).
        seen: Observations before each action and at the end, T + 1 arrays.
        noise: Standard normal noise of the actions, (T, n, nu), before its scaling.
    """

    states: Array
    actions: Array
    rewards: Array
    seen: list[Array]
    noise: Tensor


class Learner:
    """State of a training: environments, networks and optimizers. The environments must end episodes by truncation only.

    Args:
        envs: Vector environment.
        task: Observation and reward as PyTorch functions.
        plan: Hyperparameters.
    """

    def __init__(self, envs: Any, task: Differentiable, plan: Plan):
        self.envs, self.task, self.plan = envs, task, plan
        base = envs.unwrapped
        self.sim, self.skip = base.sim, base.task.frame_skip
        model = self.sim.model
        if model.nq != model.nv or model.na:
            sizes = f"nq {model.nq}, nv {model.nv}, na {model.na}"
            raise ValueError(f"the model has {sizes}: use one without quaternions (nq = nv) and without activations (na = 0)")
        self.nv, self.dt = model.nv, model.timestep * self.skip
        self.moments = stepper.Stepper(model, plan.num_envs * plan.horizon, options=self.sim.options, threads=plan.threads)
        torch.manual_seed(plan.seed)
        space = envs.single_action_space
        self.middle, self.half = (
            torch.tensor(x, dtype=torch.float32) for x in ((space.high + space.low) / 2, (space.high - space.low) / 2)
        )
        size = envs.single_observation_space.shape[0]
        self.net, self.ahead = (ActorCritic(size, space.shape[0], Settings(initial_std=plan.std)) for _ in range(2))
        self.ahead.load_state_dict(self.net.state_dict())
        self.actor = torch.optim.Adam([*self.net.actor.parameters(), self.net.log_std], lr=plan.rate, betas=(0.7, 0.95))
        self.critic = torch.optim.Adam(self.net.critic.parameters(), lr=plan.critic_rate, betas=(0.7, 0.95))
        self.observed, self.returned = Moments(size), Moments(1)
        self.discounted, self.earned, self.age = np.zeros((3, plan.num_envs))
        length = envs.spec.max_episode_steps
        if length % plan.horizon:
            raise ValueError(f"episodes have {length} actions, which is no multiple of the horizon {plan.horizon}: give another --horizon")
        self.windows = length // plan.horizon
        self.observation = envs.reset(seed=plan.seed * 1_000_003)[0]
        self.observed.update(self.observation)
        self.steps, self.updates, self.recent = 0, 0, deque[float](maxlen=plan.num_envs)

    def normal(self, observation: Tensor) -> Tensor:
        """Normalised observations, float32, clipped to ±10."""
        mean, std = torch.from_numpy(self.observed.mean), torch.from_numpy(np.sqrt(self.observed.var + 1e-8))
        return ((observation - mean) / std).clamp(-10.0, 10.0).float()

    def act(self, observation: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Actions of the policy, and the part of the network's output beyond the range of the actions.

        Gradients ignore the clipping to the range (straight-through).

        Args:
            observation: Normalised observations.
            noise: Standard normal noise.
        """
        asked = self.net.actor(self.normal(observation)) + torch.exp(self.net.log_std) * noise
        beyond = asked - asked.detach().clamp(-1.0, 1.0)
        return self.middle + self.half * (asked - beyond.detach()), beyond

    def slow(self, done: float) -> None:
        """Set the learning rate of the policy, which decreases linearly from `Plan.rate` to a tenth of this value.

        `done` is the finished fraction of the training.
        """
        for group in self.actor.param_groups:
            group["lr"] = self.plan.rate * (1.0 - 0.9 * done)

    def begin_some(self) -> None:
        """Resets the environments whose episode is over.

        The episodes are staggered, so that each horizon has samples of all parts of an episode.
        """
        over = (self.updates + np.arange(self.plan.num_envs)) % self.windows == 0
        if over.any() and self.updates:
            self.recent += [float(r) for r in self.earned[over & (self.age == self.windows)]]
            self.observation = self.envs.reset(options={"reset_mask": over})[0]
            self.discounted[over] = self.earned[over] = self.age[over] = 0.0
        self.age += 1

    def collect(self) -> Horizon:
        """Step all environments for one horizon (the number of actions through which a gradient propagates), and return the samples."""
        plan = self.plan
        self.begin_some()
        T, n, nu = plan.horizon, plan.num_envs, len(self.middle)
        made = Horizon(np.zeros((T + 1, n, 2 * self.nv)), np.zeros((T, n, nu)), np.zeros((T, n)), [self.observation], torch.randn(T, n, nu))
        made.states[0] = np.concatenate([self.sim.qpos, self.sim.qvel], axis=1)
        for t in range(T):
            with torch.no_grad():
                action = self.act(torch.from_numpy(self.observation), made.noise[t])[0].numpy()
            made.actions[t] = action
            self.observation, made.rewards[t], *_ = self.envs.step(action)
            made.states[t + 1] = np.concatenate([self.sim.qpos, self.sim.qvel], axis=1)
            made.seen.append(self.observation)
            self.discounted = self.discounted * plan.gamma + made.rewards[t]
            self.returned.update(self.discounted[:, None])
        self.earned += made.rewards.sum(axis=0)
        self.steps += T * n
        return made

    def update(self) -> dict[str, float]:
        """Step all environments for one horizon, and update the policy and the value network with the samples. Returns metrics by name."""
        made = self.collect()
        loss, kinks, left_out = self.objective(made)
        self.actor.zero_grad()
        loss.backward()
        norm = float(nn.utils.clip_grad_norm_([*self.net.actor.parameters(), self.net.log_std], self.plan.bound))
        if not math.isfinite(norm):
            raise FloatingPointError(f"the gradient of update {self.updates} is not finite: give a shorter --horizon")
        self.actor.step()
        error = self._learn_values(torch.from_numpy(np.stack(made.seen)), torch.from_numpy(made.rewards).float() * self._scale())
        self.observed.update(np.stack(made.seen[1:]))
        self.updates += 1
        std = float(torch.exp(self.net.log_std.detach()).mean())
        return {"gradient": norm, "value_error": error, "near_kink": kinks, "left_out": left_out, "std": std}

    def _scale(self) -> float:
        """Factor for rewards: the inverse of the standard deviation of the returns."""
        return float(1.0 / np.sqrt(self.returned.var[0] + 1e-8))

    def objective(self, made: Horizon) -> tuple[Tensor, float, float]:
        """Loss of the policy on collected samples, as a differentiable function of the policy's weights.

        States follow the linearized steps x' = x'_0 + A (x - x_0) + B (u - u_0). Here x_0, u_0 and x'_0 are the collected states, actions
        and next states, and A and B the matrices of `linearize`. The value of the loss is that of the collected samples, and its gradient
        propagates through A and B.

        Returns:
            Loss, fraction of the steps near a kink (where a step has no derivative, such as at a change of contacts), and fraction of the
            environments that are left out for lack of a derivative.
        """
        states, actions, noise = made.states, made.actions, made.noise
        T, n, size = len(actions), actions.shape[1], states.shape[2]
        flat = states[:-1].reshape(T * n, size)
        self.moments.set_state(flat[:, : self.nv], flat[:, self.nv :])
        lin = self.moments.linearize(ctrl=actions.reshape(T * n, -1), nstep=self.skip, centered=False)
        A, B = (torch.from_numpy(x.reshape(T, n, size, -1)) for x in (lin.A, lin.B))
        were, acted = torch.from_numpy(states), torch.from_numpy(actions)
        total, state = torch.zeros(n, dtype=torch.float64), were[0]
        for t in range(T):
            observation = self.task.observation(state[:, : self.nv], state[:, self.nv :])
            action, beyond = self.act(observation, noise[t])
            off = A[t] @ (state - were[t])[..., None] + B[t] @ (action - acted[t])[..., None]
            after = were[t + 1] + off[..., 0]
            reward = self.task.reward(state[:, : self.nv], after[:, : self.nv], after[:, self.nv :], action, self.dt)
            if not self.updates:
                self._check(observation, made.seen[t], "observation")
                self._check(reward, made.rewards[t], "reward")
            total = total + self.plan.gamma**t * (self._scale() * reward - self.plan.beyond * beyond.square().sum(dim=1))
            state = after
        last = self.normal(self.task.observation(state[:, : self.nv], state[:, self.nv :]))
        total = total + self.plan.gamma**T * self.ahead.critic(last).squeeze(-1)
        # Environments with a step without a derivative are left out of the loss.
        kept = torch.from_numpy(~lin.undetermined.reshape(T, n).any(axis=0))
        loss = -(total * kept).sum() / max(int(kept.sum()), 1) / T
        return loss, float(np.mean(lin.near_kink)), 1.0 - float(kept.double().mean())

    @staticmethod
    def _check(ours: Tensor, theirs: Array, what: str) -> None:
        """Raises ValueError if a result of the task's PyTorch functions differs from that of the task.

        Args:
            ours: Result of the PyTorch function.
            theirs: Result of the task.
            what: Name of the result for the message.
        """
        worst = float(np.abs(ours.detach().numpy() - theirs).max())
        if worst > 1e-5:  # The task gets its actions as float32.
            raise ValueError(f"the {what} in PyTorch differs from the task's by {worst:.1e}: correct it in TASKS")

    def _learn_values(self, seen: Tensor, rewards: Tensor) -> float:
        """Fit the value network to TD(lambda) targets. Returns the mean squared error."""
        plan, (T, n) = self.plan, rewards.shape
        states = self.normal(seen)
        with torch.no_grad():
            values = self.ahead.critic(states).squeeze(-1)
            targets, ahead = torch.empty(T, n), values[T]
            for t in reversed(range(T)):
                ahead = rewards[t] + plan.gamma * ((1.0 - plan.trace) * values[t + 1] + plan.trace * ahead)
                targets[t] = ahead
        inputs, wanted, errors = states[:-1].flatten(0, 1), targets.flatten(), []
        for _ in range(plan.epochs):
            for rows in torch.randperm(T * n).chunk(4):
                error = (self.net.critic(inputs[rows]).squeeze(-1) - wanted[rows]).square().mean()
                self.critic.zero_grad()
                error.backward()
                nn.utils.clip_grad_norm_(self.net.critic.parameters(), plan.bound)
                self.critic.step()
                errors.append(float(error.detach()))
        with torch.no_grad():
            for old, new in zip(self.ahead.critic.parameters(), self.net.critic.parameters(), strict=True):
                old.lerp_(new, 1.0 - plan.follow)
        return float(np.mean(errors))

    def policy(self, **notes: Any) -> Policy:
        """Learned policy as a NumPy policy. `notes` has further entries for its field `training`."""
        linear = [layer for layer in self.net.actor if isinstance(layer, nn.Linear)]
        return Policy(
            mean=self.observed.mean,
            std=np.sqrt(self.observed.var + 1e-8),
            clip=10.0,
            layers=tuple((layer.weight.detach().numpy().T.copy(), layer.bias.detach().numpy().copy()) for layer in linear),
            activation="tanh",
            low=np.asarray(self.envs.single_action_space.low, dtype=np.float64),
            high=np.asarray(self.envs.single_action_space.high, dtype=np.float64),
            environment=describe(self.envs),
            training=asdict(self.plan) | notes,
        )


def train(env: str, minutes: float, plan: Plan, folder: Path, *, quiet: bool = False) -> Learner:
    """Train a task of `TASKS` for some minutes of processor time. Writes curve.csv and policy.npz to a folder."""
    if env not in TASKS:
        raise ValueError(f"{env} has no PyTorch functions in TASKS of shac.py: add them, or train one of {', '.join(TASKS)}")
    torch.set_num_threads(plan.threads)
    envs = gymnasium.make_vec(env, num_envs=plan.num_envs, threads=plan.threads, autoreset_mode=AutoresetMode.DISABLED)
    learner = Learner(envs, TASKS[env], plan)
    folder.mkdir(parents=True, exist_ok=True)
    begun, spent = time.perf_counter(), time.process_time()
    with (folder / "curve.csv").open("w", newline="") as file:
        writer = None
        while (processor := time.process_time() - spent) < 60.0 * minutes:
            learner.slow(processor / (60.0 * minutes))
            progress = learner.update()
            row = {"iteration": learner.updates, "steps": learner.steps, "seconds": round(time.perf_counter() - begun, 2)}
            row |= {"processor": round(time.process_time() - spent, 2), "episodes": len(learner.recent)}
            row |= {"return": float(np.mean(learner.recent)) if learner.recent else math.nan} | progress
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            file.flush()
            if not quiet and learner.updates % 20 == 0:
                print(f"{learner.steps:>9,} steps {row['processor']:6.0f} s  return {row['return']:8.1f}", progress, flush=True)
    learner.policy(env=env, steps=learner.steps, processor=round(processor, 1)).save(folder / "policy.npz")
    return learner


def main() -> None:
    """Train and evaluate a policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "env", nargs="?", default="stepper/HalfCheetah-v5", choices=list(TASKS), help="id of the task [stepper/HalfCheetah-v5]"
    )
    parser.add_argument("--minutes", type=float, default=5.0, help="length of the training in processor time, min [5]")
    parser.add_argument("--out", type=Path, help="folder for the results [out/shac/ENV/seedN]")
    for name, value in asdict(Plan()).items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=type(value), default=value, help=f"[{value}]")
    given = vars(parser.parse_args())
    env, minutes, out = (given.pop(name) for name in ("env", "minutes", "out"))
    plan = Plan(**given)
    folder = out or Path("out/shac", env.replace("/", "_"), f"seed{plan.seed}")
    learner = train(env, minutes, plan, folder)
    print(f"{learner.steps:,} steps; wrote curve.csv and policy.npz to {folder}")
    print(evaluate(learner.policy(), env, episodes=20, seed=EVALUATION_SEED))


if __name__ == "__main__":
    main()
