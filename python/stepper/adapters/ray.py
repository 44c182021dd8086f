"""Environments, rollouts and sweeps that run on Ray, on one machine or a cluster."""

from __future__ import annotations

import io
import math
import pickle
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper._stepper import Model
from stepper.adapters.native import Env, make_native
from stepper.envs.task import Array
from stepper.shared.machine import require
from stepper.shared.ray_tasks import each_task, running_ray

require("ray", "for stepper.adapters.ray")

import ray  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.spaces import flatdim  # noqa: E402
from gymnasium.vector import AutoresetMode, VectorEnv  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402
from ray import cloudpickle  # noqa: E402
from ray.exceptions import ObjectLostError, RayActorError  # noqa: E402

from stepper.envs.vector import StepperVectorEnv  # noqa: E402

Policy: TypeAlias = Callable[[Array, np.random.Generator], ArrayLike]
"""Function that returns actions (n, nu) from observations (n, k) of a block of environments, and from the block's random generator."""
Call: TypeAlias = tuple[str, tuple[Any, ...]]
"""Name of a method of `_Block`, and its arguments."""
Results: TypeAlias = list[Any]
"""Return values of one method call, one for each block of environments."""

_LOST = (RayActorError, ObjectLostError)
"""Errors that Ray raises if an actor has died, or if the machine that stored its return value is lost."""
_ATTEMPTS = 5
"""Largest number of attempts at a call. Each repetition runs in a new actor; after the last one, the error of the lost actor is raised."""


class RayVectorEnv(VectorEnv[Array, Array, Array]):
    """Vector environment that is divided into blocks. Actors of Ray step the blocks.

    Results are identical bit for bit to those of one `StepperVectorEnv`, for any number of actors. The model is compiled once and shared
    through Ray's object store. If an actor dies, a new one restores its blocks: it starts from their last saved state or their seeds, and
    repeats the calls since then. Ray is started if it is not running.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        num_actors: Number of actors. None selects as many as Ray's CPUs allow, at least one and at most one per block. If there are too few
            CPUs for the given number, a warning is issued, and the first call waits until the cluster has grown.
        block_size: Number of environments per block. `run_policy` calls the policy for one block at a time, so that its results do not
            depend on the number of actors.
        save_every: Number of calls after which this process copies all states as a backup. If an actor dies, at most that many calls are
            repeated.
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
        save_every: int = 200,
        actor_options: dict[str, Any] | None = None,
        **settings: Any,
    ):
        self._actors: list[Any] = []
        for name, value in (("num_envs", num_envs), ("block_size", block_size), ("save_every", save_every)):
            if value < 1:
                raise ValueError(f"{name} is {value}, must be at least 1")
        blocks = math.ceil(num_envs / block_size)
        if num_actors is not None and not 1 <= num_actors <= blocks:
            blocks_of = f"the number of blocks of {block_size} in {num_envs} environments: lower block_size for more"
            raise ValueError(f"num_actors is {num_actors}, must be from 1 to {blocks}, {blocks_of}")
        running_ray("for stepper.adapters.ray")
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
        self._start: Callable[[], Any] = lambda: ray.remote(_Host).options(**options).remote(env, model, settings)
        self._actors = [self._start() for _ in range(count)]
        # Block b belongs to actor b % count.
        self._shares = [list(range(actor, blocks, count)) for actor in range(count)]
        self._saved: list[bytes | None] = [None] * blocks
        self._calls: list[list[Call]] = [[] for _ in range(blocks)]
        self._save_every, self._begun, self._whole, self._rollouts = save_every, False, True, 0
        self._seed = int(np.random.SeedSequence().generate_state(1, np.uint32)[0])
        self._forget()

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
            ValueError: The number of seeds is not num_envs, the reset_mask is not boolean (num_envs,), or an option is unknown.
        """
        seeds = _seeds(seed, self.num_envs)
        if not self._begun:  # Environments without a seed get one here, so that a lost block can be repeated.
            seeds = [self._seed + k if value is None else value for k, value in enumerate(seeds)]
        if unknown := set(options or {}) - {"reset_mask"}:
            raise ValueError(f"unknown options {sorted(unknown)}, the only option is 'reset_mask'")
        mask = np.ones(self.num_envs, dtype=bool) if options is None else options.get("reset_mask", np.ones(self.num_envs, dtype=bool))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"reset_mask is {mask!r}, must be an array of bool, ({self.num_envs},), with at least one True")
        if not self._begun and not mask.all():
            raise ResetNeeded("some environments have no episode yet: call reset without reset_mask first")
        super().reset(seed=seed if isinstance(seed, int) else None)
        if seed is not None:
            self._seed, self._rollouts = seeds[0] or 0, 0
        if mask.all() and None not in seeds:  # The next states do not depend on earlier calls.
            self._forget()
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

    def _forget(self) -> None:
        """Discards the saved states and the recorded calls of all blocks. The next call then creates the blocks again."""
        self._saved = [None] * len(self._slices)
        self._calls = [[("make", (part.stop - part.start,))] for part in self._slices]
        self._whole, self._made = True, False

    def _run(self, calls: list[Call]) -> Results:
        """Runs one method call in every block of environments.

        Returns the result of each block. A new actor replaces one that has died, and repeats the calls since the last backup.
        """
        if not self._actors:
            raise RuntimeError("the environments are closed")
        if not self._whole:
            raise RuntimeError("a call failed or was interrupted in some environments: call reset(seed=...)")
        self._whole = False  # Set to True again when all blocks have returned.
        before = [[] if self._made else calls_before for calls_before in self._calls]
        pending = [
            actor.run.remote({b: [*before[b], calls[b]] for b in share}) for actor, share in zip(self._actors, self._shares, strict=True)
        ]
        results: Results = [None] * len(calls)
        for k, share in enumerate(self._shares):
            for attempt in range(_ATTEMPTS):
                try:
                    returned = ray.get(pending[k])
                    break
                except _LOST:
                    if attempt + 1 == _ATTEMPTS:
                        raise
                    pending[k] = self._replace_actor(k, calls)
            for block in share:
                results[block] = returned[block]
                self._calls[block].append(calls[block])
        self._whole = self._made = True
        if max(map(len, self._calls)) > self._save_every:
            self._save()
        return results

    def _replace_actor(self, k: int, calls: list[Call]) -> Any:
        """Starts a new actor in place of actor k, which has died, and repeats the calls since the last backup.

        Returns a Ray reference to the results of `calls`, the last call of each block.
        """
        ray.kill(self._actors[k])  # The actor may be alive but unreachable.
        self._actors[k] = self._start()
        share = self._shares[k]
        states = {b: saved for b in share if (saved := self._saved[b]) is not None}
        return self._actors[k].run.remote({b: [*self._calls[b], calls[b]] for b in share}, states)

    def _save(self) -> None:
        """Copies the states of all blocks from the actors to this process, and discards the recorded calls that led to these states."""
        pending = [actor.save.remote() for actor in self._actors]
        for k, share in enumerate(self._shares):
            try:
                states = ray.get(pending[k])
            except _LOST:
                continue  # The recorded calls stay, and the next call replaces the actor.
            for block in share:
                self._saved[block], self._calls[block] = states[block], []


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
    tasks = each_task(running_ray("for stepper.adapters.ray"), run, shared, cases, max_retries=attempts, **(options or {}))
    return [made for _, made in sorted(tasks, key=lambda task: task[0])]


class _Host:
    """Actor of Ray that contains blocks of environments of one model."""

    def __init__(self, env: Env, model: Model, settings: dict[str, Any]):
        self._env, self._model, self._settings = env, model, settings
        self._blocks: dict[int, _Block] = {}

    def run(self, calls: dict[int, list[Call]], states: dict[int, bytes] | None = None) -> dict[int, Any]:
        """Restores blocks from pickled states, if any, then makes the calls of each block in order.

        Args:
            calls: Calls by index of the block. The call "make" creates the block's environments.
            states: Pickled blocks from `save`, by index of the block.

        Returns:
            Value of the last call of each block, by index of the block.
        """
        for block, state in (states or {}).items():
            self._blocks[block] = _Unpickler(io.BytesIO(state), self._model).load()
        results: dict[int, Any] = {}
        for block, of_block in calls.items():
            for name, arguments in of_block:
                if name == "make":
                    self._blocks[block] = _Block(make_native(self._env, *arguments, model=self._model, **self._settings))
                    results[block] = None
                else:
                    results[block] = getattr(self._blocks[block], name)(*arguments)
        return results

    def save(self) -> dict[int, bytes]:
        """Pickled blocks of this actor, without their common model, by index of the block."""
        states = {}
        for block, value in self._blocks.items():
            file = io.BytesIO()
            _Pickler(file, self._model).dump(value)
            states[block] = file.getvalue()
        return states


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


class _Pickler(cloudpickle.CloudPickler):  # type: ignore[misc]
    """Pickler for environments that writes a reference instead of their model, which is large and which every actor has already."""

    def __init__(self, file: io.BytesIO, model: Model):
        super().__init__(file)
        self._model = model

    def persistent_id(self, thing: Any) -> str | None:
        return "model" if isinstance(thing, Model) and thing == self._model else None


class _Unpickler(pickle.Unpickler):
    """Unpickler that puts `model` in place of the references that `_Pickler` has written instead of the model."""

    def __init__(self, file: io.BytesIO, model: Model):
        super().__init__(file)
        self._model = model

    def persistent_load(self, name: str) -> Model:
        return self._model


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


def _seeds(seed: int | Sequence[int | None] | None, num_envs: int) -> list[int | None]:
    """Seed of each environment; None for environments without a seed.

    A single seed gives environment i the seed `seed + i`. A sequence has one entry per environment.
    """
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, int | np.integer):
        return [int(seed) + k for k in range(num_envs)]
    if len(seed) != num_envs:
        raise ValueError(f"there are {len(seed)} seeds, must be {num_envs}: one for each environment, or None for those without")
    return list(seed)


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
