"""Proximal policy optimisation (PPO) in one file: trains, evaluates and films a policy, and writes learning curve and checkpoints.

    stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

Each update adds a row to the learning curve. A checkpoint is written after the first update, and then every half a minute. The same
command continues a stopped run, and the curve is the same as without the stop. With the id `HalfCheetah-v5`, the learner trains in
Gymnasium's environment. Checkpoints do not include the state of that environment: a stopped run continues with new episodes, so that its
curve differs from an uninterrupted run.

To change the learner, write a copy of this file with `stepper train --copy my_ppo.py`, and train with `python my_ppo.py`.

The method is that of Schulman et al. (2017, https://arxiv.org/abs/1707.06347), with generalised advantages (2016,
https://arxiv.org/abs/1506.02438). Running means and variances normalise observations and rewards. The learning rate is adapted
so that the Kullback-Leibler divergence of an update stays near a target.

If the task has an observation group "critic", the critic sees this group, and the policy sees the group "policy" (Pinto et al. 2018,
https://arxiv.org/abs/1710.06542).
"""

from __future__ import annotations

import csv
import dataclasses
import io
import os
import time
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from stepper.shared.machine import require

if __name__ == "__main__":
    print("importing PyTorch", flush=True)
# By default, waiting threads of OpenMP are busy, which takes processor time from the physics.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
for name in ("torch", "gymnasium"):
    require(name, "to train", "train")

import numpy as np  # noqa: E402
import torch  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from torch import Tensor, nn  # noqa: E402

from stepper.envs import StepperVectorEnv  # noqa: E402
from stepper.policies import Policy, check_film, describe, evaluate, film, is_native, make  # noqa: E402
from stepper.policies.evaluation import FILMED  # noqa: E402
from stepper.policies.ppo_settings import (  # noqa: E402
    CHECKPOINT,
    Settings,
    arguments,
    check_bounds,
    copy_learner,
    default_folder,
    kept_at_interrupt,
    settings_of,
)
from stepper.shared.environments import import_env  # noqa: E402
from stepper.shared.files import atomic_write, check_archive, explained, locked, os_errors_of, read_text, write_text  # noqa: E402
from stepper.shared.progress import progress_lines  # noqa: E402

Array = NDArray[Any]


EVALUATION_SEED = 2**32
"""Seed of the evaluation, from which its episodes get seeds that no training episode has."""
PRINT_INTERVAL = 5.0
"""Time between two lines of progress, s."""


class Moments:
    """Running mean and variance of every column of a stream of rows, updated with batches by Chan's method."""

    def __init__(self, size: int):
        self.mean, self.var, self.count = np.zeros(size), np.ones(size), 1e-4

    def update(self, batch: Array) -> None:
        """Updates the running mean and variance with a batch of rows, (n, size), in any unit."""
        rows = batch.reshape(-1, len(self.mean)).astype(np.float64)
        shift, total = rows.mean(axis=0) - self.mean, self.count + len(rows)
        self.var = (self.var * self.count + rows.var(axis=0) * len(rows) + shift**2 * self.count * len(rows) / total) / total
        self.mean, self.count = self.mean + shift * len(rows) / total, total


class ActorCritic(nn.Module):
    """Two networks: the actor returns the mean of Gaussian actions, the critic the value of a state.

    Actions are in units of half their range. Their standard deviation does not depend on the state.

    Args:
        observations: Number of columns of the actor's observations.
        actions: Number of actions.
        settings: Settings of the run.
        critic: Number of columns of the critic's observations; None means those of the actor.
        half: Half the range of each action, (actions,), for `settings.action_std`.
    """

    def __init__(self, observations: int, actions: int, settings: Settings, critic: int | None = None, half: Array | None = None):
        super().__init__()
        self.actor = _network(observations, settings, actions, gain=0.01)
        self.critic = _network(observations if critic is None else critic, settings, 1, gain=1.0)
        self.log_std = nn.Parameter(torch.full((actions,), float(np.log(settings.initial_std))))
        if settings.action_std and half is not None:
            self.log_std.data = torch.from_numpy(np.log(settings.action_std / half).astype(np.float32))

    def log_prob(self, mean: Tensor, action: Tensor) -> Tensor:
        """Log probability densities, (n,), of actions (n, nu) with means (n, nu)."""
        scaled = (action - mean) * torch.exp(-self.log_std)
        return -0.5 * (scaled * scaled).sum(-1) - self.log_std.sum() - 0.5 * np.log(2.0 * np.pi) * mean.shape[-1]


def _network(inputs: int, settings: Settings, outputs: int, gain: float) -> nn.Sequential:
    """Network with the hidden layers of the settings and orthogonal initial weights; `gain` scales those of the last layer."""
    sizes = [inputs, *settings.hidden, outputs]
    layers = [nn.Linear(*ends) for ends in pairwise(sizes)]
    for layer, scale in zip(layers, [2**0.5] * len(settings.hidden) + [gain], strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    activation = {"tanh": nn.Tanh, "elu": nn.ELU, "relu": nn.ReLU}[settings.activation]
    return nn.Sequential(layers[0], *(part for layer in layers[1:] for part in (activation(), layer)))


class Run:
    """State of a training run: environments, networks, optimizer, running moments and counters."""

    def __init__(self, settings: Settings):
        self.settings = settings
        torch.manual_seed(settings.seed)
        native = {"threads": settings.threads, "groups": True} if is_native(settings.env) else {}
        self.envs = make(settings.env, settings.num_envs, training=True, **settings.environment(), **native)
        space = self.envs.single_action_space
        check_bounds(settings.env, space)
        self.middle, self.half = (space.high + space.low) / 2, (space.high - space.low) / 2
        seen = self.envs.single_observation_space
        sizes = {name: box.shape[0] for name, box in seen.items()} if native else {"policy": seen.shape[0]}
        self.has_groups, self.seen_by_critic = bool(native), "critic" if "critic" in sizes else "policy"
        sizes = {name: sizes[name] for name in dict.fromkeys(("policy", self.seen_by_critic))}
        self.net = ActorCritic(sizes["policy"], space.shape[0], settings, sizes[self.seen_by_critic], self.half)
        self.optimizer = torch.optim.Adam(self.net.parameters(), lr=settings.learning_rate, eps=1e-5, fused=True)
        self.observed, self.returned = {name: Moments(size) for name, size in sizes.items()}, Moments(1)
        self.discounted = np.zeros(settings.num_envs)
        self.observation = self.groups(self.envs.reset(seed=settings.seed * 1_000_003)[0])
        for name, moments in self.observed.items():
            moments.update(self.observation[name])
        self.steps, self.iteration, self.seconds, self.processor = 0, 0, 0.0, 0.0
        self.episodes, self.recent = 0, deque[tuple[float, int]](maxlen=100)
        weights = getattr(self.envs.unwrapped, "reward_weights", {})
        self.terms = {f"return_{name}": deque[float](maxlen=100) for name, weight in weights.items() if weight}

    def groups(self, observation: Any) -> dict[str, Array]:
        """Observations by group, (num_envs, n), from an observation of the environments."""
        return dict(observation) if self.has_groups else {"policy": observation}

    def observed_std(self, group: str = "policy") -> Array:
        """Standard deviations by which the observations of a group are divided, (n,), in their units."""
        return np.sqrt(self.observed[group].var + self.settings.min_std**2)

    def normal(self, observation: Array, group: str = "policy") -> Tensor:
        """Observations normalised by their running mean and standard deviation, and clipped to +-10: (num_envs, n) float32 tensor."""
        scaled = (observation - self.observed[group].mean) / self.observed_std(group)
        return torch.from_numpy(np.clip(scaled, -10.0, 10.0).astype(np.float32))

    @torch.no_grad()
    def collect(self) -> dict[str, Tensor]:
        """Steps all environments `horizon` times and returns samples with advantages: tensors (samples, ...) by name."""
        s, net, critic = self.settings, self.net, self.seen_by_critic
        shape = (s.horizon, s.num_envs)
        seen = {name: np.empty((*shape, len(moments.mean)), dtype=np.float32) for name, moments in self.observed.items()}
        states, actions = {name: torch.empty(part.shape) for name, part in seen.items()}, torch.empty(*shape, len(self.middle))
        means, values = torch.empty_like(actions), torch.empty(s.horizon + 1, s.num_envs)
        rewards, lasts, ends = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=bool)
        std = torch.exp(net.log_std)
        for t in range(s.horizon):
            for name, part in seen.items():
                part[t] = self.observation[name]
                states[name][t] = self.normal(self.observation[name], name)
            means[t] = net.actor(states["policy"][t])
            actions[t] = means[t] + std * torch.randn(means[t].shape)
            values[t] = net.critic(states[critic][t]).squeeze(-1)
            bounded = np.clip(actions[t].numpy(), -1.0, 1.0)
            observation, reward, terminated, truncated, info = self.envs.step(self.middle + self.half * bounded)
            self.observation = self.groups(observation)
            over = terminated | truncated
            self.discounted = self.discounted * s.gamma + reward
            self.returned.update(self.discounted[:, None])
            self.discounted[over] = 0.0
            rewards[t], ends[t] = reward, over
            if over.any():
                self._count(info, over)
                cut = np.flatnonzero(truncated & ~terminated)
                if len(cut):  # A truncated episode is bootstrapped with the value of its last state.
                    final = self.normal(np.stack([self.groups(last)[critic] for last in info["final_obs"][cut]]), critic)
                    lasts[t, cut] = net.critic(final).squeeze(-1).numpy()
        values[s.horizon] = net.critic(self.normal(self.observation[critic], critic)).squeeze(-1)
        for name, moments in self.observed.items():
            moments.update(seen[name])
        self.steps += s.horizon * s.num_envs
        scale = 1.0 / np.sqrt(self.returned.var[0] + 1e-8)
        reward_of = torch.from_numpy((rewards * scale + s.gamma * lasts).astype(np.float32))
        going = torch.from_numpy((~ends).astype(np.float32))
        advantages, ahead = torch.empty(shape), torch.zeros(s.num_envs)
        for t in reversed(range(s.horizon)):
            error = reward_of[t] + s.gamma * going[t] * values[t + 1] - values[t]
            ahead = error + s.gamma * s.gae_lambda * going[t] * ahead
            advantages[t] = ahead
        flat = {"state": states["policy"], "action": actions, "mean": means, "advantage": advantages, "return": advantages + values[:-1]}
        if critic != "policy":
            flat["seen"] = states[critic]
        samples = {name: part.flatten(0, 1) for name, part in flat.items()}
        samples["log_prob"] = net.log_prob(samples["mean"], samples["action"])
        return samples

    def _count(self, info: dict[str, Any], over: Array) -> None:
        """Adds returns and lengths of ended episodes to `recent`, their number to `episodes`, and returns of reward terms to `terms`.

        `over` is a mask of the environments whose episode ended, (num_envs,).
        """
        episode = info.get("episode") or info["final_info"]["episode"]
        self.recent += [(float(r), int(n)) for r, n in zip(episode["r"][over], episode["l"][over], strict=True)]
        self.episodes += int(over.sum())
        for name, recent in self.terms.items():
            recent.extend(info["final_info"][name][over].tolist())

    def update(self, samples: dict[str, Tensor]) -> dict[str, float]:
        """Trains the networks on samples of `collect`, adapts the learning rate, and returns statistics for the learning curve."""
        s, net, count = self.settings, self.net, len(samples["return"])
        old_log_std = net.log_std.detach().clone()
        losses, clipped = [], []
        for _ in range(s.epochs):
            order = torch.randperm(count)
            mixed = {name: part[order] for name, part in samples.items()}
            for k in range(0, count - s.minibatch + 1, s.minibatch):
                one = {name: part[k : k + s.minibatch] for name, part in mixed.items()}
                advantage = (one["advantage"] - one["advantage"].mean()) / (one["advantage"].std() + 1e-8)
                ratio = torch.exp(net.log_prob(net.actor(one["state"]), one["action"]) - one["log_prob"])
                gain = torch.minimum(advantage * ratio, advantage * ratio.clamp(1.0 - s.clip, 1.0 + s.clip)).mean()
                error = 0.5 * (net.critic(one.get("seen", one["state"])).squeeze(-1) - one["return"]).square().mean()
                loss = s.value * error - gain - s.entropy * net.log_std.sum()
                self.optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(net.parameters(), s.max_grad_norm)
                self.optimizer.step()
                losses.append(float(error.detach()))
                clipped.append(float(((ratio.detach() - 1.0).abs() > s.clip).float().mean()))
        with torch.no_grad():
            kl = _divergence(samples["mean"], old_log_std, net.actor(samples["state"]), net.log_std)
        for group in self.optimizer.param_groups:
            rate = group["lr"]
            group["lr"] = max(rate / 1.5, 1e-5) if kl > 2.0 * s.target_kl else min(rate * 1.5, 1e-2) if kl < 0.5 * s.target_kl else rate
        explained = 1.0 - float(samples["advantage"].var() / samples["return"].var())
        return {
            "kl": kl,
            "clipped": float(np.mean(clipped)),
            "value_error": float(np.mean(losses)),
            "explained_variance": explained,
            "std": float(torch.exp(net.log_std.detach()).mean()),
            "learning_rate": rate,
        }

    def policy(self) -> Policy:
        """Current actor as a `Policy` in NumPy."""
        linear = [layer for layer in self.net.actor if isinstance(layer, nn.Linear)]
        layers = tuple((layer.weight.detach().numpy().T.copy(), layer.bias.detach().numpy().copy()) for layer in linear)
        space = self.envs.single_action_space
        training = dataclasses.asdict(self.settings) | {"seconds": round(self.seconds, 1), "torch": torch.__version__}
        return Policy(
            mean=self.observed["policy"].mean,
            std=self.observed_std(),
            clip=10.0,
            layers=layers,
            activation=self.settings.activation,
            low=np.asarray(space.low, dtype=np.float64),
            high=np.asarray(space.high, dtype=np.float64),
            environment=describe(self.envs),
            training=training,
        )

    def save(self, file: Path) -> None:
        """Writes a checkpoint atomically. The file is a pickle: load only files that you trust."""
        state = {name: value for name, value in self.__dict__.items() if name not in ("net", "optimizer", "envs")}
        state |= {
            "settings": vars(self.settings),
            "net": self.net.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "random": torch.get_rng_state(),
        }
        # Environments of stepper pickle with their state; others begin new episodes.
        state["envs"] = self.envs if isinstance(self.envs.unwrapped, StepperVectorEnv) else None
        data = io.BytesIO()
        torch.save(state, data)
        with atomic_write(file) as stream:
            stream.write(data.getbuffer())

    @classmethod
    def load(cls, file: Path) -> Run:
        """Restores a run from a checkpoint."""
        state = read_checkpoint(file)
        run = cls(Settings(**state.pop("settings")))
        run.net.load_state_dict(state.pop("net"))
        run.optimizer.load_state_dict(state.pop("optimizer"))
        envs, random = state.pop("envs"), state.pop("random")
        if envs is None:  # The new episodes have no observation and no return yet.
            del state["observation"], state["discounted"]
        else:
            run.envs = envs
        run.__dict__ |= state
        torch.set_rng_state(random)
        return run


def read_checkpoint(file: Path) -> dict[str, Any]:
    """State of a run in a checkpoint."""
    with explained(file, "restore the checkpoint, or delete it to begin the run again"):
        check_archive(file)
        state: dict[str, Any] = torch.load(file, weights_only=False)
        if not isinstance(state, dict) or "settings" not in state:
            raise ValueError("it is no checkpoint of stepper train")
    return state


def _divergence(mean: Tensor, log_std: Tensor, new_mean: Tensor, new_log_std: Tensor) -> float:
    """Mean over states of the Kullback-Leibler divergence of the old from the new Gaussian, KL(old, new), nats."""
    var, new_var = torch.exp(2.0 * log_std), torch.exp(2.0 * new_log_std)
    parts = new_log_std - log_std + (var + (mean - new_mean).square()) / (2.0 * new_var) - 0.5
    return float(parts.sum(-1).mean())


def train(settings: Settings, folder: Path, *, every: float = 30.0, quiet: bool = False) -> Run:
    """Trains a policy, or continues the run of a folder.

    Args:
        settings: Settings of the run.
        folder: Folder for curve.csv, checkpoint.pt and policy.npz.
        every: Time between two checkpoints, s. The first is written after the first update.
        quiet: Whether to suppress progress output.

    Returns:
        The completed run.

    Raises:
        ValueError: The folder contains a run with other settings, or a damaged checkpoint.
        BlockingIOError: Another run writes to the folder.
        KeyboardInterrupt: After Ctrl-C, and a message on how to continue.
    """
    with locked(folder), kept_at_interrupt(folder / CHECKPOINT):
        return _train(settings, folder, every=every, quiet=quiet)


def _train(settings: Settings, folder: Path, *, every: float, quiet: bool) -> Run:
    """Trains a policy in a locked folder; see `train`."""
    torch.set_num_threads(settings.threads)
    curve, checkpoint = folder / "curve.csv", folder / CHECKPOINT
    if not quiet:
        action = "continuing" if checkpoint.exists() else "starting"
        print(f"{settings.env}: {action} a run of {settings.num_envs:,} environments, seed {settings.seed}, in {folder}", flush=True)
    if checkpoint.exists():
        run = Run.load(checkpoint)
        theirs, ours = dict(vars(run.settings)), vars(settings)
        theirs["steps"], run.settings = settings.steps, settings  # A run may continue with more steps.
        if found := [f"{name} is {theirs[name]} there, {ours[name]} here" for name in ours if theirs.get(name) != ours[name]]:
            raise ValueError(f"{folder} contains a run with other settings: {'; '.join(found)}; give another folder with --out")
    else:
        run = Run(settings)
    _cut(curve, run.iteration)
    if not quiet:
        continued = f", from step {run.steps:,} on" if run.steps else ""
        rest = f"a line every {PRINT_INTERVAL:.0f} s, and every update in {curve}"
        print(f"training for {settings.steps:,} steps{continued}; {rest}", flush=True)
    printed = -np.inf
    saved, begun, spent = -np.inf, time.perf_counter() - run.seconds, time.process_time() - run.processor
    while run.steps < settings.steps:
        losses = run.update(run.collect())
        run.iteration += 1
        run.seconds, run.processor = time.perf_counter() - begun, time.process_time() - spent
        returns, length = np.mean(run.recent, axis=0) if run.recent else (float("nan"), float("nan"))
        row = {"iteration": run.iteration, "steps": run.steps, "seconds": round(run.seconds, 2), "processor": round(run.processor, 2)}
        row |= {"episodes": run.episodes, "return": float(returns), "length": float(length)} | losses
        row |= {name: float(np.mean(recent)) if recent else float("nan") for name, recent in run.terms.items()}
        _append(curve, row)
        if not quiet and (time.perf_counter() - printed > PRINT_INTERVAL or run.steps >= settings.steps):
            printed = time.perf_counter()
            result = f"return {returns:9.1f}  length {length:6.1f}" if run.recent else "no episode has ended yet"
            print(f"{run.steps:>12,} steps {run.seconds:6.0f} s  {result}", flush=True)
        if time.perf_counter() - saved > every or run.steps >= settings.steps:
            run.save(checkpoint)
            if run.steps < settings.steps:
                run.policy().save(folder / "policy.npz")
            saved = time.perf_counter()
    run.policy().save(folder / "policy.npz")
    return run


def _cut(curve: Path, iteration: int) -> None:
    """Removes the rows of a learning curve after the iteration of the checkpoint, because the continued run repeats these iterations."""
    if curve.exists():
        lines = read_text(curve, "learning curve").splitlines(keepends=True)
        write_text(curve, "".join(lines[: iteration + 1]))


def _append(curve: Path, row: dict[str, float]) -> None:
    """Appends a row to a CSV file, after a header if the file is new."""
    new = not curve.exists() or not curve.stat().st_size
    with os_errors_of(curve), curve.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if new:
            writer.writeheader()
        writer.writerow(row)


def main(words: Sequence[str] | None = None, prog: str | None = None) -> None:
    """Trains a policy, evaluates it, and films it if `--film` is given.

    Args:
        words: Arguments of the command line; None uses the arguments of the process.
        prog: Name of the command in the help text; None uses the name of the file.
    """
    given = vars(arguments(prog).parse_args(words))
    env, out, episodes, video, copy = (given.pop(name) for name in ("env", "out", "evaluate", "film", "copy"))
    if copy is not None:
        copy_learner(Path(__file__), copy)
        return
    if episodes < 2:
        raise ValueError(f"--evaluate is {episodes}, must be at least 2: one episode has no confidence interval")
    env = import_env(env)
    settings = settings_of(env, given)
    folder = out or default_folder(settings)
    if video is not None:
        # PyTorch imports this for its first optimizer. After a picture by OpenGL in software, the import can crash the process.
        import torch._dynamo  # noqa: F401, PLC0415

        check_film(env, video, **settings.environment())
    run = train(settings, folder)
    policy = run.policy()
    print(f"{run.steps:,} steps in {run.seconds:.0f} s, {run.processor:.0f} s of processor time; the run is in {folder}")
    print(f"evaluating {episodes} new episodes", flush=True)
    print(evaluate(policy, env, episodes=episodes, seed=EVALUATION_SEED, **settings.environment()), flush=True)
    if video is not None:
        print(f"filming at most {FILMED} actions", flush=True)
        count = film(policy, env, video, actions=FILMED, seed=EVALUATION_SEED, progress=progress_lines(), **settings.environment())
        print(f"wrote {video}, with {count} actions")


if __name__ == "__main__":
    main()
