"""Returns of a policy over fresh episodes, and whether two environments give it the same."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.shared.environments import known
from stepper.shared.machine import require
from stepper.shared.progress import Tick, silent

Array = NDArray[Any]
Act = Callable[[Array], Array]
"""Controller with actions (num_envs, nu) for observations (num_envs, n): a `Policy`, or any function."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Episodes of a policy in an environment.

    Attributes:
        env: Name of the environment.
        returns: Sums of rewards, (episodes,).
        lengths: Actions, (episodes,).
        non_finite: Episodes that ended because their state would not have been finite.
        infos: Means over each episode of the requested infos, (episodes,), by name.
    """

    env: str
    returns: Array
    lengths: Array
    non_finite: int = 0
    infos: Mapping[str, Array] = field(default_factory=dict)

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(self.returns.mean())

    def interval(self, confidence: float = 0.95, info: str = "") -> tuple[float, float]:
        """Student's confidence interval of the mean return, or of the mean of one of `infos`."""
        return _interval(self.infos[info] if info else self.returns, confidence)

    def __str__(self) -> str:
        low, high = self.interval()
        text = (
            f"{self.env}: {self.mean:.1f} mean return of {len(self.returns)} episodes, 95 % confidence {low:.1f} to {high:.1f}, "
            f"worst {self.returns.min():.1f}, best {self.returns.max():.1f}, mean length {self.lengths.mean():.1f}"
        )
        for name, means in self.infos.items():
            low, high = self.interval(info=name)
            text += f", {name} {means.mean():.4g} ({low:.4g} to {high:.4g})"
        return text + (f", {self.non_finite} ended as their state would not have been finite" if self.non_finite else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Comparison of a policy in two environments, from the same starts.

    Two one-sided tests (Schuirmann's): the mean returns are equivalent if the confidence interval of their paired difference at 1 - 2 alpha
    lies within the margin, which has both tests at the level alpha.

    Attributes:
        one: Episodes in the first environment.
        other: Episodes in the second, from the same starts.
        margin: Largest difference of mean returns that counts as none, as a fraction of the first's mean return.
        alpha: Level of each test: with 0.05 two environments that differ by the margin are called equivalent in at most 5 % of cases.
    """

    one: Evaluation
    other: Evaluation
    margin: float = 0.02
    alpha: float = 0.05

    @property
    def difference(self) -> float:
        """Mean of the paired differences of returns, second less first."""
        return float((self.other.returns - self.one.returns).mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the difference at 1 - 2 alpha: 90 % by default."""
        return _interval(self.other.returns - self.one.returns, 1.0 - 2.0 * self.alpha)

    @property
    def bound(self) -> float:
        """The margin as a return."""
        return self.margin * abs(self.one.mean)

    @property
    def verdict(self) -> str:
        """Whether the interval lies within the margin ("equivalent"), beyond it ("different"), or across its bound ("open")."""
        low, high = self.interval
        if -self.bound < low and high < self.bound:
            return "equivalent"
        return "different" if low > self.bound or high < -self.bound else "open"

    def __str__(self) -> str:
        low, high = self.interval
        return (
            f"{self.other.env} less {self.one.env}: {self.difference:+.1f} ({_share(self.difference, self.one.mean)}), "
            f"{1.0 - 2.0 * self.alpha:.0%} confidence {low:+.1f} to {high:+.1f}, margin {self.bound:.1f}: {self.verdict}"
        )


def make(env: str, num_envs: int | None = None, **settings: Any) -> Any:
    """An environment by its name, of stepper or of Gymnasium.

    Args:
        env: Its name, with its module and a colon before it where importing that registers it: "push_task:me/Push-v0".
        num_envs: Number of environments; None is a single one.
        **settings: Its arguments.

    Raises:
        ValueError: There is none of that name.
        MissingPackageError: Gymnasium, or what its MuJoCo environments need, is not installed.
    """
    gymnasium = require("gymnasium", "to evaluate policies")
    importlib.import_module("stepper.envs")  # It registers its environments.
    env = known(env)
    try:
        point = str(gymnasium.spec(env).entry_point)
    except gymnasium.error.Error as error:
        raise ValueError(str(error)) from error
    if point.startswith("gymnasium.envs.mujoco"):
        require("imageio", "for MuJoCo environments of Gymnasium's")
    return gymnasium.make(env, **settings) if num_envs is None else gymnasium.make_vec(env, num_envs=num_envs, **settings)


def evaluate(
    policy: Act,
    env: str,
    *,
    episodes: int = 20,
    seed: int = 0,
    starts: tuple[Array, Array] | None = None,
    infos: Sequence[str] = (),
    tick: Tick | None = None,
    **settings: Any,
) -> Evaluation:
    """Runs a policy in fresh episodes.

    Args:
        policy: What acts.
        env: Name of an environment in Gymnasium. Those of `stepper.envs`, and those of which there are only vector environments,
            run all episodes at once, others one after the other.
        episodes: How many.
        seed: Episode k has the seed `seed + k`.
        starts: Configurations (episodes, nq) and velocities (episodes, nv) that episodes begin from, in place of those of the seeds.
        infos: Names of infos, one number of each environment, whose means over each episode are taken too.
        tick: Called with the environment's name and the fraction done.
        **settings: Arguments of the environment.

    Raises:
        ValueError: No such environment, settings or infos that it does not have, or fewer than two episodes.
        MissingPackageError: Gymnasium is not installed.
    """
    if episodes < 2:
        raise ValueError(f"episodes is {episodes}, must be at least 2: one has no confidence interval")
    if is_native(env) or _is_vector_alone(env):
        return _together(make(env, episodes, **settings), policy, seed, starts, infos, tick=tick or silent)
    return _one_by_one(make(env, **settings), policy, range(seed, seed + episodes), starts, infos, tick=tick or silent)


def is_native(env: str) -> bool:
    """Whether environments of a name are those of `stepper.envs`, a task of the user's own among them."""
    gymnasium = require("gymnasium", "to evaluate policies")
    importlib.import_module("stepper.envs")  # It registers its environments.
    spec = gymnasium.registry.get(known(env))
    return spec is not None and str(spec.vector_entry_point) in ("stepper.envs:StepperVectorEnv", "stepper.envs.vector:StepperVectorEnv")


def _is_vector_alone(env: str) -> bool:
    """Whether a name in Gymnasium has vector environments and no single ones."""
    spec = require("gymnasium", "to evaluate policies").registry.get(known(env))
    return spec is not None and spec.entry_point is None and spec.vector_entry_point is not None


def compare(
    policy: Act,
    one: str,
    other: str,
    *,
    episodes: int = 100,
    seed: int = 0,
    margin: float = 0.02,
    alpha: float = 0.05,
    settings: tuple[dict[str, Any], dict[str, Any]] = ({}, {}),
    tick: Tick | None = None,
) -> Comparison:
    """Runs a policy in two environments from the same starts, those that a stepper environment draws from its seeds.

    Args:
        policy: What acts.
        one: An environment, of `stepper.envs` or Gymnasium's own of the same task.
        other: Another; one of the two is of `stepper.envs`.
        episodes: In each.
        seed: Episode k has the seed `seed + k`.
        margin: See `Comparison`.
        alpha: See `Comparison`; with 0.025 the interval is one of 95 %.
        settings: Arguments of the two environments.
        tick: As of `evaluate`.

    Raises:
        ValueError: Neither is one of stepper's; and what `evaluate` raises.
    """
    ours = [(name, given) for name, given in zip((one, other), settings, strict=True) if is_native(name)]
    if not ours:
        raise ValueError(f"the environments are {one!r} and {other!r}: one must be of stepper, whose starts both have")
    starts = _starts(ours[0][0], episodes, seed, ours[0][1])
    first, second = (
        evaluate(policy, name, episodes=episodes, seed=seed, starts=starts, tick=tick, **given)
        for name, given in zip((one, other), settings, strict=True)
    )
    return Comparison(one=first, other=second, margin=margin, alpha=alpha)


def _starts(env: str, episodes: int, seed: int, settings: dict[str, Any]) -> tuple[Array, Array]:
    """Initial states of the episodes of some seeds."""
    envs = make(env, episodes, **settings)
    envs.reset(seed=seed)
    return envs.unwrapped.sim.qpos.astype(np.float64), envs.unwrapped.sim.qvel.astype(np.float64)


def _together(envs: Any, policy: Act, seed: int, starts: tuple[Array, Array] | None, infos: Sequence[str], *, tick: Tick) -> Evaluation:
    """Every episode in a separate environment. Those that are over go on with another, which is not counted."""
    observation, _ = envs.reset(seed=seed)
    if starts is not None:
        observation = envs.unwrapped.set_state(*starts)
    returns, lengths = np.zeros(envs.num_envs), np.zeros(envs.num_envs, dtype=np.int64)
    running, failed = np.ones(envs.num_envs, dtype=bool), np.zeros(envs.num_envs, dtype=bool)
    sums = {key: np.zeros(envs.num_envs) for key in infos}
    while running.any():
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        returns[running] += reward[running]
        for key, total in sums.items():
            total[running] += _info(info, key)[running]
        lengths += running
        failed |= running & np.asarray(info.get("non_finite", False))
        running &= ~(terminated | truncated)
        limit = envs.spec.max_episode_steps or np.inf
        tick(envs.spec.id, float(max(1.0 - running.mean(), lengths.max() / limit)))
    means = {key: total / lengths for key, total in sums.items()}
    return Evaluation(env=envs.spec.id, returns=returns, lengths=lengths, non_finite=int(failed.sum()), infos=means)


def _one_by_one(env: Any, policy: Act, seeds: range, starts: tuple[Array, Array] | None, infos: Sequence[str], *, tick: Tick) -> Evaluation:
    returns, lengths = np.zeros(len(seeds)), np.zeros(len(seeds), dtype=np.int64)
    sums = {key: np.zeros(len(seeds)) for key in infos}
    for k, seed in enumerate(seeds):
        observation, _ = env.reset(seed=seed)
        if starts is not None:
            env.unwrapped.set_state(starts[0][k], starts[1][k])
            observation = env.unwrapped._get_obs()  # Gymnasium's MuJoCo environments have no public name for it.
        over = False
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy(np.asarray(observation)[None])[0])
            returns[k] += reward
            for key, total in sums.items():
                total[k] += _info(info, key)
            lengths[k] += 1
            over = terminated or truncated
        tick(env.spec.id, (k + 1) / len(seeds))
    env.close()
    return Evaluation(env=env.spec.id, returns=returns, lengths=lengths, infos={key: total / lengths for key, total in sums.items()})


def _info(info: Mapping[str, Any], name: str) -> Array:
    """A number of each environment that a step's info has."""
    if name not in info or np.ndim(info[name]) > 1:
        numbers = sorted(key for key, value in info.items() if not key.startswith("_") and np.ndim(value) < 2)
        raise ValueError(f"the infos have no number {name!r}, they have: {', '.join(numbers) or 'none'}")
    return np.asarray(info[name], dtype=np.float64)


def _interval(values: Array, confidence: float) -> tuple[float, float]:
    stats = require("scipy.stats", "for confidence intervals")
    half = float(stats.t.ppf(0.5 + confidence / 2.0, len(values) - 1)) * float(values.std(ddof=1)) / math.sqrt(len(values))
    return float(values.mean()) - half, float(values.mean()) + half


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / abs(whole):+.1f} %" if whole else "of nothing"
