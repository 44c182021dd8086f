"""Environments, rollouts and sweeps that run on Ray, on one machine or a cluster."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper._stepper import Model
from stepper.adapters.native import Env, make_native
from stepper.envs.task import Array
from stepper.shared.arguments import check_whole
from stepper.shared.machine import require

require("ray", "for stepper.adapters.ray")

import ray  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.spaces import flatdim  # noqa: E402
from gymnasium.vector import AutoresetMode, VectorEnv  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402

from stepper.envs.vector import StepperVectorEnv, reset_mask, seeds_of  # noqa: E402

Policy: TypeAlias = Callable[[Array, np.random.Generator], ArrayLike]
"""Function that returns actions (n, nu) from observations (n, k) of a block of environments, and from the block's random generator."""
Call: TypeAlias = tuple[str, tuple[Any, ...]]
"""Name of a method of `_Block`, and its arguments."""
Results: TypeAlias = list[Any]
"""Return values of one method call, one for each block of environments."""


class RayVectorEnv(VectorEnv[Array, Array, Array]):
    """Vector environment that is divided into blocks. Actors of Ray step the blocks.

    Results are identical bit for bit to those of one `StepperVectorEnv`, for any number of actors. The model is compiled once and shared
    through Ray's object store. Ray is started if it is not running. If an actor is lost, calls raise Ray's error: make new environments.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        num_actors: Number of actors. None selects as many as Ray's CPUs allow, at least one and at most one per block. If there are too few
            CPUs for the given number, a warning is issued, and the first call waits until the cluster has grown.
        block_size: Number of environments per block. `run_policy` calls the policy for one block at a time, so that its results do not
            depend on the number of actors.
        actor_options: Arguments of Ray's `options` for an actor, such as {"resources": ...}. The default is one CPU per thread.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. The default `autoreset_mode` is SAME_STEP.

    Raises:
        ValueError: A number is out of range, or there are more actors than blocks.
    """

    def __init__(
        self,
        env: Env,
        num_envs: int,
        *,
        num_actors: int | None = None,
        block_size: int = 64,
        actor_options: dict[str, Any] | None = None,
        **settings: Any,
    ):
        self._actors: list[Any] = []
        for name, value in (("num_envs", num_envs), ("block_size", block_size)):
            check_whole(name, value, least=1)
        blocks = math.ceil(num_envs / block_size)
        if num_actors is not None and not 1 <= num_actors <= blocks:
            blocks_of = f"the number of blocks of {block_size} in {num_envs} environments: lower block_size for more"
            raise ValueError(f"num_actors is {num_actors}, must be from 1 to {blocks}, {blocks_of}")
        _start_ray()
        settings = {"autoreset_mode": AutoresetMode.SAME_STEP, **settings}
        one = make_native(env, 1, **settings)
        self.num_envs, self.autoreset_mode, self.metadata = num_envs, one.autoreset_mode, one.metadata
        self.single_observation_space, self.single_action_space = one.single_observation_space, one.single_action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._slices = [slice(k, min(k + block_size, num_envs)) for k in range(0, num_envs, block_size)]
        options = {"num_cpus": max(1, one.sim.threads), **(actor_options or {})}
        count = _count(num_actors, blocks, options["num_cpus"] or 0, ray.cluster_resources().get("CPU", 0))
        model = ray.put(one.sim.model)
        # Block b belongs to actor b % count.
        self._shares = [list(range(actor, blocks, count)) for actor in range(count)]
        sizes = [part.stop - part.start for part in self._slices]
        start = ray.remote(_Host).options(**options).remote
        self._actors = [start(env, model, {b: sizes[b] for b in share}, settings) for share in self._shares]
        self._begun, self._whole, self._rollouts = False, True, 0
        self._seed = int(np.random.SeedSequence().generate_state(1, np.uint32)[0])

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begins new episodes, like `StepperVectorEnv.reset`.

        Args:
            seed: Seed or seeds, as in `StepperVectorEnv.reset`.
            options: Options, as in `StepperVectorEnv.reset`.

        Returns:
            Observations (num_envs, n), and infos.

        Raises:
            TypeError, ValueError: The number of seeds is not num_envs, the reset_mask is not boolean (num_envs,), or an option is unknown.
        """
        seeds, mask = seeds_of(seed, self.num_envs), reset_mask(options, self.num_envs)
        if not self._begun and not mask.all():
            raise ResetNeeded("some environments have no episode yet: call reset without reset_mask first")
        super().reset(seed=seed if isinstance(seed, int) else None)
        if seed is not None:
            self._seed, self._rollouts = seeds[0] or 0, 0
        self._whole |= bool(mask.all()) and None not in seeds  # The next states then do not depend on earlier calls.
        results = self._run([("reset", (seeds[part], mask[part])) for part in self._slices])
        self._begun = True
        observation, infos = self._joined(results)
        return observation, infos

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advances every environment by one action, which may be several time steps, like `StepperVectorEnv.step`.

        Args:
            actions: Actions, (num_envs, nu), in the units of the task.
        """
        actions = np.ascontiguousarray(actions, dtype=np.float64)
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {actions.shape}, must be {self.action_space.shape}")
        self._check_begun("step")
        results = self._run([("step", (actions[part],)) for part in self._slices])
        observation, reward, terminated, truncated, infos = self._joined(results)
        return observation, reward, terminated, truncated, infos

    def run_policy(self, policy: Policy, num_steps: int) -> dict[str, Array]:
        """Runs a policy for many steps inside the actors. Episodes continue from the current state.

        Args:
            policy: Function that returns actions (n, nu) from observations (n, k) and a random generator. It is pickled once, and called
                for one block at a time. The generator is seeded by the seed of the last reset, the index of the block and the number of
                rollouts since that reset.
            num_steps: Number of actions per environment.

        Returns:
            Arrays by name: "observation" and "next_observation" (num_steps, num_envs, k), "action" (num_steps, num_envs, nu), "reward",
            "terminated" and "truncated" (num_steps, num_envs). At the end of an episode, "next_observation" is the last observation of that
            episode. "last_observation" (num_envs, k) is the input of the policy's next action.

        Raises:
            ValueError: num_steps is below 1, or the autoreset is not SAME_STEP, because other modes ignore some actions.
            ResetNeeded: `reset` was not called yet.
            ray.exceptions.RayTaskError: The policy raised an error. Blocks may then have made different numbers of steps:
                call `reset(seed=...)`.
        """
        if num_steps < 1:
            raise ValueError(f"num_steps is {num_steps}, must be at least 1")
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {self.autoreset_mode}, must be SAME_STEP for rollouts")
        self._check_begun("run_policy")
        shared = ray.put(policy)
        seeds = [(self._seed, self._rollouts, block) for block in range(len(self._slices))]
        parts = self._run([("run_policy", (shared, num_steps, seed)) for seed in seeds])
        self._rollouts += 1
        axes = {"last_observation": 0}
        return {name: np.concatenate([part[name] for part in parts], axis=axes.get(name, 1)) for name in parts[0]}

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the actors, but not Ray."""
        if ray.is_initialized():  # Without Ray, the actors have ended already.
            for actor in self._actors:
                ray.kill(actor)
        self._actors = []

    def _check_begun(self, name: str) -> None:
        """Raises ResetNeeded if `reset` was not called; `name` is the method for the message."""
        if not self._begun:
            raise ResetNeeded(f"call reset before {name}")

    def _joined(self, results: Results) -> Any:
        """Concatenates the values that all blocks returned from `reset` or `step`, along the axis of environments."""
        sizes = [part.stop - part.start for part in self._slices]
        *arrays, infos = zip(*results, strict=True)
        return *(np.concatenate(array) for array in arrays), _join_infos(infos, sizes)

    def _run(self, calls: list[Call]) -> Results:
        """Runs one method call in every block of environments, and returns the result of each block."""
        if not self._actors:
            raise RuntimeError("the environments are closed")
        if not self._whole:
            raise RuntimeError("a call failed or was interrupted in some environments: call reset(seed=...)")
        self._whole = False  # Set to True again when all blocks have returned.
        pending = [actor.run.remote({b: calls[b] for b in share}) for actor, share in zip(self._actors, self._shares, strict=True)]
        results = {block: result for returned in ray.get(pending) for block, result in returned.items()}
        self._whole = True
        return [results[block] for block in range(len(calls))]


def run_policy(env: Env, policy: Policy, num_envs: int, num_steps: int, *, seed: int | None = None, **settings: Any) -> dict[str, Array]:
    """Runs a policy in new environments on Ray: creates a `RayVectorEnv`, calls `reset` and `run_policy`, and closes it.

    Args:
        env: Environment, as in `RayVectorEnv`.
        policy: Policy, as in `RayVectorEnv.run_policy`.
        num_envs: Number of environments.
        num_steps: Number of actions per environment.
        seed: Seed. Environment i has `seed + i`; None draws a random seed.
        **settings: Further arguments of `RayVectorEnv`.

    Returns:
        Arrays by name, as returned by `RayVectorEnv.run_policy`.
    """
    envs = RayVectorEnv(env, num_envs, **settings)
    try:
        envs.reset(seed=seed)
        return envs.run_policy(policy, num_steps)
    finally:
        envs.close()


def map_cases(
    run: Callable[..., Any], cases: Iterable[Any], *shared: Any, attempts: int = 3, options: dict[str, Any] | None = None
) -> list[Any]:
    """Calls `run(*shared, case)` for every case, in parallel on Ray. Examples of cases are values of friction, or contact models.

    If a call fails, the others are cancelled.

    Args:
        run: Function to call. Its return value is pickled.
        cases: Last argument of each call.
        *shared: First arguments of all calls, such as models, policies and arrays; they are pickled once.
        attempts: Largest number of repetitions of a case whose worker died.
        options: Arguments of Ray's `options` for a task, such as {"num_cpus": 2}.

    Returns:
        Return values of the calls, in the order of the cases.

    Raises:
        ray.exceptions.RayTaskError: `run` raised an error.
    """
    _start_ray()
    references = [ray.put(value) for value in shared]
    task = ray.remote(run).options(max_retries=attempts, **(options or {}))
    calls = [task.remote(*references, case) for case in cases]
    try:
        waiting = calls
        while waiting:
            (done,), waiting = ray.wait(waiting, num_returns=1)
            ray.get(done)
    except BaseException:
        for left in waiting:
            ray.cancel(left)
        raise
    made: list[Any] = ray.get(calls)
    return made


def _start_ray() -> None:
    """Starts Ray if it is not running."""
    if not ray.is_initialized():
        ray.init(include_dashboard=False)


class _Host:
    """Actor of Ray that contains blocks of environments of one model; `sizes` are their numbers of environments, by index of the block."""

    def __init__(self, env: Env, model: Model, sizes: dict[int, int], settings: dict[str, Any]):
        self._blocks = {block: _Block(make_native(env, size, model=model, **settings)) for block, size in sizes.items()}

    def run(self, calls: dict[int, Call]) -> dict[int, Any]:
        """Calls a method of each block, and returns the results, by index of the block."""
        return {block: getattr(self._blocks[block], name)(*arguments) for block, (name, arguments) in calls.items()}


class _Block:
    """Environments that step together as one vector environment, and their last observations, (n, k)."""

    def __init__(self, envs: StepperVectorEnv):
        self.envs = envs
        self.observation: Array = np.zeros(0)

    def reset(self, seed: list[int | None], mask: Array) -> tuple[Array, dict[str, Any]]:
        """Begins new episodes in the environments of a mask, (n,), and returns observations (n, k) and infos.

        A mask without True entries resets no environment.
        """
        if not mask.any():
            return self.observation, {}
        self.observation, infos = self.envs.reset(seed=seed, options={"reset_mask": mask})
        return self.observation, infos

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advances every environment of the block by one action, which may be several time steps.

        Args:
            actions: Actions, (n, nu), in the units of the task.
        """
        returned = self.envs.step(actions)
        self.observation = returned[0]
        return returned

    def run_policy(self, policy: Any, num_steps: int, seed: tuple[int, ...]) -> dict[str, Array]:
        """Runs a policy for `num_steps` actions in the environments of this block.

        Args:
            policy: Ray reference to a function that returns actions (n, nu) from observations (n, k) and a random generator.
            num_steps: Number of actions per environment.
            seed: Seed of the random generator.

        Returns:
            Arrays by name, as returned by `RayVectorEnv.run_policy`, for the environments of the block.
        """
        policy, draws = ray.get(policy), np.random.default_rng(seed)
        shape, width = self.observation.shape, flatdim(self.envs.single_action_space)
        out: dict[str, Array] = {
            "observation": np.empty((num_steps, *shape), dtype=self.observation.dtype),
            "next_observation": np.empty((num_steps, *shape), dtype=self.observation.dtype),
            "action": np.empty((num_steps, shape[0], width)),
            "reward": np.empty((num_steps, shape[0])),
            "terminated": np.empty((num_steps, shape[0]), dtype=bool),
            "truncated": np.empty((num_steps, shape[0]), dtype=bool),
        }
        for t in range(num_steps):
            out["observation"][t] = self.observation
            out["action"][t] = policy(self.observation, draws)
            observation, out["reward"][t], out["terminated"][t], out["truncated"][t], infos = self.step(out["action"][t])
            out["next_observation"][t] = observation
            if "final_obs" in infos:
                over = infos["_final_obs"]
                out["next_observation"][t, over] = np.stack(infos["final_obs"][over])
        out["last_observation"] = self.observation
        return out


def _count(num_actors: int | None, blocks: int, each: float, cpus: float) -> int:
    """Number of actors: `num_actors`, or else as many as the cluster's CPUs allow, at least one and at most one per block.

    Args:
        num_actors: Requested number; a warning is issued if the cluster has too few CPUs for it.
        blocks: Number of blocks of environments.
        each: Number of CPUs per actor.
        cpus: Number of CPUs of the cluster.
    """
    count = num_actors or max(1, min(blocks, int(cpus // (each or 1))))
    if count * each > cpus:
        needed = f"{count} actors with {each:g} CPUs each take {count * each:g}, and the cluster has {cpus:g}"
        warnings.warn(f"{needed}: calls wait until it has grown; lower num_actors, threads or num_cpus of actor_options", stacklevel=3)
    return count


def _join_infos(infos: Sequence[dict[str, Any]], sizes: list[int]) -> dict[str, Any]:
    """Concatenates info dictionaries of several blocks along the axis of environments.

    Args:
        infos: Dictionary of arrays per block. A block that lacks a key gets zeros (None for objects), and False in the key's mask "_key".
        sizes: Number of environments of each block.
    """
    joined: dict[str, Any] = {}
    for name in dict.fromkeys(name for info in infos for name in info):
        example = next(info[name] for info in infos if name in info)
        if isinstance(example, dict):
            joined[name] = _join_infos([info.get(name, {}) for info in infos], sizes)
        else:
            empty: Any = None if example.dtype == object else 0
            joined[name] = np.concatenate(
                [
                    info[name] if name in info else np.full((size, *example.shape[1:]), empty, dtype=example.dtype)
                    for info, size in zip(infos, sizes, strict=True)
                ]
            )
    return joined
