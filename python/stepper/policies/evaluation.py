"""Evaluation of a policy: returns of episodes, and a test of whether the mean returns in two environments are equivalent."""

from __future__ import annotations

import importlib
import math
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import WrongArgumentError
from stepper.shared.arguments import check_takes, check_whole
from stepper.shared.environments import import_env, unknown_id
from stepper.shared.machine import require, require_all
from stepper.shared.progress import ProgressCallback, silent
from stepper.shared.streams import seeds

Array = NDArray[Any]
Act = Callable[[Array], Array]
"""Function of observations, (num_envs, n), that returns actions, (num_envs, nu): a `Policy` or any other function."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Results of episodes of a policy in an environment.

    Attributes:
        env: Id of the environment.
        returns: Sum of the rewards of each episode, (episodes,).
        lengths: Number of actions of each episode, (episodes,).
        non_finite: Number of episodes that ended because the next state would not have been finite.
        infos: Means over each episode of the requested infos, (episodes,), by key.
        final_infos: Values of the requested infos after the last action of each episode, (episodes,), by key. For a sum that runs over the
            episode, this is the sum of the episode.
    """

    env: str
    returns: Array
    lengths: Array
    non_finite: int = 0
    infos: Mapping[str, Array] = field(default_factory=dict)
    final_infos: Mapping[str, Array] = field(default_factory=dict)

    @property
    def mean(self) -> float:
        """Mean return over the episodes."""
        return float(self.returns.mean())

    def interval(self, confidence: float = 0.95, info: str = "") -> tuple[float, float]:
        """Returns the confidence interval of the mean return, or of the mean of the info `info`, by Student's t distribution."""
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
            text += f", at the end {self.final_infos[name].mean():.4g}" if name in self.final_infos else ""
        return text + (f", {self.non_finite} ended because their next state would not have been finite" if self.non_finite else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Comparison of a policy in two environments, from the same initial states.

    Equivalence is tested by two one-sided tests (Schuirmann), each at the level alpha. The mean returns are equivalent if the confidence
    interval of their paired difference, at 1 - 2 alpha, lies within the margin.

    Attributes:
        one: Episodes in the first environment.
        other: Episodes in the second environment, from the same initial states.
        margin: Largest difference of mean returns that counts as equivalent, as a fraction of the mean return in the first environment.
        alpha: Level of each test. At 0.05, environments that differ by exactly the margin pass as equivalent in at most 5 % of cases.
    """

    one: Evaluation
    other: Evaluation
    margin: float = 0.02
    alpha: float = 0.05

    @property
    def difference(self) -> float:
        """Mean of the paired differences of returns, second minus first environment."""
        return float((self.other.returns - self.one.returns).mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval (low, high) of the mean difference of returns, with confidence 1 - 2 alpha: 90 % by default."""
        return _interval(self.other.returns - self.one.returns, 1.0 - 2.0 * self.alpha)

    @property
    def bound(self) -> float:
        """Largest difference of mean returns that counts as equivalent, in the unit of the return."""
        return self.margin * abs(self.one.mean)

    @property
    def verdict(self) -> str:
        """Result of the equivalence test, from the confidence interval of the difference of mean returns.

        The result is "equivalent" if the interval lies within +-`bound`, and "different" if the interval lies completely outside. If the
        interval overlaps an end of this range, the test does not decide, and the result is "open".
        """
        low, high = self.interval
        if -self.bound < low and high < self.bound:
            return "equivalent"
        return "different" if low > self.bound or high < -self.bound else "open"

    def __str__(self) -> str:
        low, high = self.interval
        return (
            f"{self.other.env} minus {self.one.env}: {self.difference:+.1f} ({_percentage(self.difference, self.one.mean)}), "
            f"{1.0 - 2.0 * self.alpha:.0%} confidence {low:+.1f} to {high:+.1f}, margin {self.bound:.1f}: {self.verdict}"
        )


def make(env: str, num_envs: int | None = None, *, training: bool = False, **settings: Any) -> Any:
    """Creates an environment of Gymnasium's registry, simulated by stepper or by another simulator.

    Args:
        env: Id of the environment. A module that registers the environment can precede the id: "push_task:me/Push-v0".
        num_envs: Number of environments; None makes a single environment, not a vector environment.
        training: Whether a vector environment has the autoreset mode SAME_STEP and the infos of `RecordEpisodeStatistics`.
        **settings: Arguments of the environment.

    Raises:
        ValueError: The id is not registered.
        TypeError: The environment has no argument of this name.
        MissingPackageError: Gymnasium, or a package that its MuJoCo environments need, is not installed.
    """
    try:
        return _made(env, num_envs, training=training, **settings)
    except TypeError as error:
        if not isinstance(error, WrongArgumentError) and "got an unexpected keyword argument" in str(error):
            raise WrongArgumentError(str(error)) from error
        raise


def _made(env: str, num_envs: int | None, *, training: bool, **settings: Any) -> Any:
    """Creates an environment like `make`, which converts the TypeError of an unknown argument."""
    gymnasium = require("gymnasium", "to run policies")
    importlib.import_module("stepper.envs")  # The import registers the environments.
    has_module, env = ":" in str(env), import_env(env)
    try:
        spec = gymnasium.spec(env)
    except gymnasium.error.Error as error:
        told = unknown_id(error, env, gymnasium.registry)
        own = "; for an environment of your own write the module that registers it first, as in my_task:me/Reach-v0"
        raise ValueError(told + ("" if has_module else own)) from error
    if str(spec.entry_point).startswith("gymnasium.envs.mujoco"):
        require_all(("mujoco", "glfw", "imageio", "packaging"), f"for {env}, Gymnasium's environment on MuJoCo", "envs")
    if num_envs is None:
        return gymnasium.make(env, **settings)
    if not training:
        return gymnasium.make_vec(env, num_envs=num_envs, **settings)
    mode: dict[str, Any] = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    if is_native(env):
        return gymnasium.make_vec(env, num_envs=num_envs, **mode, episode_statistics=True, **settings)
    # The mode is an argument of native vector environments. For vectors of single environments it is in `vector_kwargs`.
    mode = mode if spec.vector_entry_point else {"vector_kwargs": mode}
    return gymnasium.wrappers.vector.RecordEpisodeStatistics(gymnasium.make_vec(env, num_envs=num_envs, **mode, **settings))


def evaluate(
    policy: Act,
    env: str,
    *,
    episodes: int = 20,
    seed: int = 0,
    starts: tuple[Array, Array] | None = None,
    infos: Sequence[str] = (),
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> Evaluation:
    """Runs a policy for a number of episodes and returns the results.

    Args:
        policy: Function of observations, (num_envs, n), that returns actions, (num_envs, nu): a `Policy` or any other.
        env: Id of an environment in Gymnasium's registry. Environments of `stepper.envs`, and others that have only a vector
            environment, run all episodes in parallel; the rest run one episode after the other.
        episodes: Number of episodes, at least 2.
        seed: Seed of the evaluation, from which the episodes get independent seeds (`stepper.envs.seeds`). An environment of
            another package that only exists as a vector environment gets the first of them as its `seed`.
        starts: Initial positions (episodes, nq), m and rad, and velocities (episodes, nv), m/s and rad/s. None draws them from the seeds.
        infos: Keys of the info dict whose values are one number per environment. The result has the mean of each over every episode, and
            its value at the end of every episode.
        progress: Function that is called with the environment's id and the fraction of the work that is done.
        **settings: Arguments of the environment.

    Returns:
        Results of the episodes.

    Raises:
        ValueError: The environment, a setting or a key of the info dict is unknown, or there are fewer than two episodes.
        MissingPackageError: Gymnasium is not installed.
    """
    check_whole("episodes", episodes)
    check_whole("seed", seed, least=0)
    if not callable(policy):
        raise TypeError(f"policy is {policy!r}, must be a stepper.policies.Policy or a function of observations")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress is {progress!r}, must be a function of a text and a fraction, or None")
    if isinstance(infos, str) or not isinstance(infos, Sequence) or not all(isinstance(key, str) for key in infos):
        raise TypeError(f"infos is {infos!r}, must be a list of keys of the info dict, as ['tracking_error']")
    if episodes < 2:
        raise ValueError(f"episodes is {episodes}, must be at least 2: one episode gives no confidence interval")
    check_takes(policy, ["observations"], "policy")
    drawn = seeds(seed, episodes)
    if is_native(env):
        return _in_parallel(make(env, episodes, **settings), policy, drawn, starts, infos, progress=progress or silent)
    if _has_only_vector_environment(env):
        return _in_parallel(make(env, episodes, **settings), policy, drawn[0], starts, infos, progress=progress or silent)
    return _in_sequence(make(env, **settings), policy, drawn, starts, infos, progress=progress or silent)


def is_native(env: str) -> bool:
    """Whether the environment with the id `env` is simulated by stepper: a task of `stepper.envs`, or a task that the user registered."""
    gymnasium = require("gymnasium", "to evaluate policies")
    importlib.import_module("stepper.envs")  # The import registers the environments.
    spec = gymnasium.registry.get(import_env(env))
    return spec is not None and str(spec.vector_entry_point) in ("stepper.envs:StepperVectorEnv", "stepper.envs.vector:StepperVectorEnv")


def _has_only_vector_environment(env: str) -> bool:
    """Whether Gymnasium's registry has only a vector environment, and no single environment, for the id `env`."""
    spec = require("gymnasium", "to evaluate policies").registry.get(import_env(env))
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
    progress: ProgressCallback | None = None,
) -> Comparison:
    """Runs a policy in two environments from the same initial states, and tests whether the mean returns are equivalent.

    Args:
        policy: Function of observations, (num_envs, n), that returns actions, (num_envs, nu): a `Policy` or any other.
        one: Id of the first environment, of `stepper.envs` or of Gymnasium.
        other: Id of the second environment, with the same task. At least one of the two environments must be simulated by stepper.
            The first one that stepper simulates draws the initial states of both.
        episodes: Number of episodes in each environment.
        seed: Seed of the comparison, from which the episodes get independent seeds (`stepper.envs.seeds`).
        margin: Largest difference of mean returns that counts as equivalent, as a fraction of the mean return in the first environment.
        alpha: Level of each of the two one-sided tests; 0.025 gives a 95 % interval. See `Comparison`.
        settings: Arguments of the first and of the second environment.
        progress: Function that is called with the environment's id and the fraction of the work that is done.

    Raises:
        ValueError: Neither environment is simulated by stepper, or `evaluate` raises ValueError.
    """
    ours = [(name, given) for name, given in zip((one, other), settings, strict=True) if is_native(name)]
    if not ours:
        raise ValueError(f"the environments are {one!r} and {other!r}: one must be on stepper, to draw the initial states of both")
    starts = _starts(ours[0][0], episodes, seed, ours[0][1])
    first, second = (
        evaluate(policy, name, episodes=episodes, seed=seed, starts=starts, progress=progress, **given)
        for name, given in zip((one, other), settings, strict=True)
    )
    return Comparison(one=first, other=second, margin=margin, alpha=alpha)


def _starts(env: str, episodes: int, seed: int, settings: dict[str, Any]) -> tuple[Array, Array]:
    """Initial positions (episodes, nq), m and rad, and velocities (episodes, nv), m/s and rad/s, of episodes that stepper simulates."""
    envs = make(env, episodes, **settings)
    envs.reset(seed=seeds(seed, episodes))
    return envs.unwrapped.sim.qpos.astype(np.float64), envs.unwrapped.sim.qvel.astype(np.float64)


def _in_parallel(
    envs: Any, policy: Act, seed: int | list[int], starts: tuple[Array, Array] | None, infos: Sequence[str], *, progress: ProgressCallback
) -> Evaluation:
    """Runs a policy for one episode in each environment of a vector environment."""
    observation, _ = envs.reset(seed=seed)
    if starts is not None:
        observation = envs.unwrapped.set_state(*starts)
    returns, lengths = np.zeros(envs.num_envs), np.zeros(envs.num_envs, dtype=np.int64)
    running, failed = np.ones(envs.num_envs, dtype=bool), np.zeros(envs.num_envs, dtype=bool)
    sums, last = ({key: np.zeros(envs.num_envs) for key in infos} for _ in range(2))
    while running.any():
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        returns[running] += reward[running]
        for key, total in sums.items():
            last[key][running] = _info(info, key)[running]
            total[running] += last[key][running]
        lengths += running
        failed |= running & np.asarray(info.get("non_finite", False))
        running &= ~(terminated | truncated)
        limit = envs.spec.max_episode_steps or np.inf
        progress(envs.spec.id, float(max(1.0 - running.mean(), lengths.max() / limit)))
    means = {key: total / lengths for key, total in sums.items()}
    failures = int(failed.sum())
    return Evaluation(env=envs.spec.id, returns=returns, lengths=lengths, non_finite=failures, infos=means, final_infos=last)


def _in_sequence(
    env: Any, policy: Act, drawn: list[int], starts: tuple[Array, Array] | None, infos: Sequence[str], *, progress: ProgressCallback
) -> Evaluation:
    """Runs a policy in a single environment, one episode after the other."""
    returns, lengths = np.zeros(len(drawn)), np.zeros(len(drawn), dtype=np.int64)
    sums, last = ({key: np.zeros(len(drawn)) for key in infos} for _ in range(2))
    for k, seed in enumerate(drawn):
        observation, _ = env.reset(seed=seed)
        if starts is not None:
            env.unwrapped.set_state(starts[0][k], starts[1][k])
            observation = env.unwrapped._get_obs()  # MuJoCo environments of Gymnasium have no public method for it.
        over = False
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy(np.asarray(observation)[None])[0])
            returns[k] += reward
            for key, total in sums.items():
                last[key][k] = _info(info, key)
                total[k] += last[key][k]
            lengths[k] += 1
            over = terminated or truncated
        progress(env.spec.id, (k + 1) / len(drawn))
    env.close()
    means = {key: total / lengths for key, total in sums.items()}
    return Evaluation(env=env.spec.id, returns=returns, lengths=lengths, infos=means, final_infos=last)


def _info(info: Mapping[str, Any], name: str) -> Array:
    """Value of the key `name` in an info dict, (num_envs,) or a number; a ValueError if the key is absent or has another shape."""
    if name not in info or np.ndim(info[name]) > 1:
        numbers = sorted(key for key, value in info.items() if not key.startswith("_") and np.ndim(value) < 2)
        raise ValueError(f"there is no info {name!r} with one number per environment; such infos are: {', '.join(numbers) or 'none'}")
    return np.asarray(info[name], dtype=np.float64)


def _interval(values: Array, confidence: float) -> tuple[float, float]:
    """Confidence interval of the mean of `values`, (n,), by Student's t distribution."""
    stats = require("scipy.stats", "for confidence intervals")
    half = float(stats.t.ppf(0.5 + confidence / 2.0, len(values) - 1)) * float(values.std(ddof=1)) / math.sqrt(len(values))
    return float(values.mean()) - half, float(values.mean()) + half


def _percentage(part: float, whole: float) -> str:
    """Text of a part as a percentage of a whole, such as "+1.2 %"; "of nothing" if the whole is 0."""
    return f"{100.0 * part / abs(whole):+.1f} %" if whole else "of nothing"


FILMED = 300
"""Default largest number of actions in a film."""


def check_film(env: str, file: str | Path, **settings: Any) -> None:
    """Checks, before a training, that `film` can film an environment on this machine. Renders one frame, and writes no file.

    Args:
        env: Id of an environment in Gymnasium's registry.
        file: Video file of the later film; only its ending is checked.
        **settings: Arguments of the environment.

    Raises:
        ValueError: The id is not registered, or the file's name does not end in .mp4.
        RuntimeError: OpenGL cannot render on this machine; the message has the remedy.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    _check_file(file)
    require("moviepy", "to write films")
    single = make(env, render_mode="rgb_array", **settings)
    try:
        single.reset(seed=0)
        single.render()
    finally:
        single.close()


def _check_file(file: str | Path) -> None:
    """Raises ValueError if the name of a film does not end in .mp4."""
    if Path(file).suffix.lower() != ".mp4":
        raise ValueError(f"the film's file is {str(file)!r}, must end in .mp4: films have this format alone")


def film(
    policy: Callable[[Array], Array],
    env: str,
    file: str | Path,
    *,
    actions: int = FILMED,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> int:
    """Films the start of an episode as a video, with Gymnasium's `RecordVideo`, which needs MoviePy.

    Args:
        policy: Function of an observation, (n,), that returns an action, (nu,): a `Policy` or any other.
        env: Id of an environment in Gymnasium's registry.
        file: Video file, mp4; an existing file is replaced.
        actions: Number of actions to film; fewer if the episode ends earlier.
        seed: Seed of the film. The filmed episode is the first episode of `evaluate` with this seed.
        progress: Function that is called after each action with the name of the film and the completed fraction. The fraction is the number
            of filmed actions divided by `actions`, or by the episode's time limit in actions if that is smaller. At the end it is 1.
        **settings: Arguments of the environment.

    Returns:
        Number of filmed actions.

    Raises:
        ValueError: The id is not registered, or the file's name does not end in .mp4.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    _check_file(file)
    check_takes(policy, ["observation"], "policy")
    require("moviepy", "to write films")
    progress = progress or silent
    gymnasium = require("gymnasium", "to film policies")
    with tempfile.TemporaryDirectory() as temporary:
        folder = str(Path(temporary, "film"))
        single = make(env, render_mode="rgb_array", **settings)
        recorded = gymnasium.wrappers.RecordVideo(single, folder, episode_trigger=lambda _: True, disable_logger=True)
        longest = min(actions, recorded.spec.max_episode_steps or actions)
        observation, _ = recorded.reset(seed=seeds(seed, 1)[0])
        count, over = 0, False
        while count < actions and not over:
            observation, _, terminated, truncated, _ = recorded.step(policy(np.asarray(observation)))
            count, over = count + 1, terminated or truncated
            progress(f"film {Path(file).name}", 1.0 if over else min(count / longest, 1.0))
        recorded.close()
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        shutil.move(next(Path(folder).glob("*.mp4")), file)
    return count
