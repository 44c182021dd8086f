"""Interface of EnvPool, `send` and `recv`: some environments step in other threads while the policy computes actions for others.

EnvPool need not be installed.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Any, TypeAlias

import numpy as np
from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import flatdim
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper.adapters.native import Env, make_native
from stepper.envs.task import Array
from stepper.envs.vector import StepperVectorEnv
from stepper.shared.machine import allowed_cores

Result: TypeAlias = tuple[Array, Array, Array, Array, dict[str, Any]]
"""Result of `recv` and `step`: observations (n, k), rewards, terminations and truncations (n,), infos."""


class StepperPool:
    """Pool of environments with EnvPool's interface. Worker threads step blocks of `batch_size` environments between `send` and `recv`.

    Block k has the `batch_size` environments from k * batch_size on. It starts to step when each of these environments has an action.
    `recv` returns blocks in the order in which they started, and environments in the order of their ids. Results and their order therefore
    depend only on seeds and actions, not on timing; EnvPool returns the first block that is ready. Later calls do not overwrite returned
    arrays.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments, a multiple of `batch_size`.
        batch_size: Number of environments that `recv` returns; None selects all of them.
        seed: Seed. Environment i has `seed + i`, as in `StepperVectorEnv`; None draws a random seed.
        threads: Number of threads, which step blocks in parallel. With more threads than blocks, several threads step a block together.
            0 uses all cores that this process may use. Results are identical bit for bit for any number.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. The autoreset is Gymnasium's NEXT_STEP, as in EnvPool.

    Raises:
        ValueError: `num_envs`, `batch_size` or `threads` is out of its range.
    """

    def __init__(
        self, env: Env, num_envs: int, batch_size: int | None = None, *, seed: int | None = None, threads: int = 1, **settings: Any
    ):
        size = num_envs if batch_size is None else batch_size
        if size < 1 or num_envs < 1 or num_envs % size:
            raise ValueError(f"num_envs is {num_envs} and batch_size {size}: num_envs must be a multiple of batch_size, both at least 1")
        if threads < 0:
            raise ValueError(f"threads is {threads}, must be at least 0; 0 is all cores that this process may use")
        threads = threads or len(allowed_cores())
        blocks = num_envs // size
        each = {"threads": max(1, threads // blocks), **settings}
        self._blocks: list[StepperVectorEnv] = [make_native(env, size, **each)]
        self._blocks += [make_native(env, size, model=self._blocks[0].sim.model, **each) for _ in range(1, blocks)]
        self._size, self._seed, self._closed = size, seed, False
        self._workers = ThreadPoolExecutor(min(threads, blocks), thread_name_prefix="stepper-pool")
        self._pending: deque[tuple[int, Future[Result]]] = deque()
        self._actions = np.zeros((blocks, size, flatdim(self._blocks[0].single_action_space)))
        # For each environment: whether it needs an action for its last observation, and whether an action is stored.
        self._waits, self._acts = np.zeros((blocks, size), dtype=bool), np.zeros((blocks, size), dtype=bool)
        self.observation_space, self.action_space = self._blocks[0].single_observation_space, self._blocks[0].single_action_space
        self.all_env_ids = np.arange(num_envs, dtype=np.int32)
        self.config: dict[str, Any] = {"num_envs": num_envs, "batch_size": size, "num_threads": threads, "seed": seed}

    def __len__(self) -> int:
        """Number of environments."""
        return len(self.all_env_ids)

    @property
    def is_async(self) -> bool:
        """Whether `recv` returns only some of the environments."""
        return len(self._blocks) > 1

    @property
    def blocks(self) -> tuple[StepperVectorEnv, ...]:
        """Vector environments of the blocks. Do not access one while a step of its block is pending."""
        return tuple(self._blocks)

    def async_reset(self) -> None:
        """Starts to reset all environments and returns immediately. `recv` then returns first observations, with rewards of 0.

        Pending steps finish first; their results and errors are discarded.
        """
        self._check_open("async_reset")
        wait([future for _, future in self._pending])
        self._pending.clear()
        self._waits[:], self._acts[:] = False, False
        for block in range(len(self._blocks)):
            seed = None if self._seed is None else self._seed + block * self._size
            self._pending.append((block, self._workers.submit(self._begin, block, seed)))
        self._seed = None  # Later resets continue the random numbers.

    def send(self, action: ArrayLike, env_id: ArrayLike | None = None) -> None:
        """Stores actions for environments and returns immediately. Blocks in which every environment has an action start to step.

        Args:
            action: Actions, (n, nu), in the units of the task.
            env_id: Ids of the environments of these actions, (n,) integers. None stands for all environments in ascending order.

        Raises:
            ValueError: A wrong shape, an unknown or repeated id, or an environment whose last observation was not received yet.
        """
        self._check_open("send")
        ids = self.all_env_ids if env_id is None else np.asarray(env_id)
        action = array_of("action", action)
        width = self._actions.shape[-1]
        if ids.ndim != 1 or action.shape != (len(ids), width):
            raise ValueError(f"actions have shape {action.shape} and env_id {ids.shape}, must be (n, {width}) and (n,)")
        if not np.issubdtype(ids.dtype, np.integer) or (ids < 0).any() or (ids >= len(self)).any():
            raise ValueError(f"env_id has {ids[:10].tolist()}, must be integers from 0 to {len(self) - 1}")
        if len(np.unique(ids)) != len(ids):
            found, counts = np.unique(ids, return_counts=True)
            raise ValueError(f"env_id has environment {found[counts > 1][0]} more than once: give each environment once")
        if not (waits := self._waits.flat[ids]).all():
            remedy = "call recv before send, or async_reset after an error"
            raise ValueError(f"environments {ids[~waits][:10].tolist()} already have an action or a pending step: {remedy}")
        self._actions.reshape(-1, width)[ids] = action
        self._waits.flat[ids], self._acts.flat[ids] = False, True
        # Blocks start in the order of their ids in `env_id`, so that the order depends only on the calls.
        for block in dict.fromkeys((ids // self._size).tolist()):
            if self._acts[block].all():
                self._acts[block] = False
                self._pending.append((block, self._workers.submit(self._blocks[block].step, self._actions[block].copy())))

    def recv(self) -> Result:
        """Waits for the block that started to step first, and returns its results.

        An error in the block's step is raised here. Other blocks are not affected; this block needs `async_reset` to continue.

        Returns:
            Observations (batch_size, n), rewards, terminations and truncations (batch_size,), and infos. Infos are
            those of `StepperVectorEnv` with "env_id" (batch_size,) int32, the ids for `send`, and "elapsed_step" (batch_size,) int32, the
            number of actions since the start of the episode.

        Raises:
            RuntimeError: No block is stepping.
        """
        if not self._pending:
            raise RuntimeError("no block is stepping: call async_reset, or send actions for all environments of a block, before recv")
        block, future = self._pending[0]
        wait([future])  # After an interrupt here, recv can be called again.
        self._pending.popleft()
        observation, reward, terminated, truncated, infos = future.result()
        self._waits[block] = True
        ids = self.all_env_ids[block * self._size : (block + 1) * self._size].copy()
        infos = infos | {"env_id": ids, "elapsed_step": self._blocks[block].episode_lengths.astype(np.int32)}
        return observation, reward, terminated, truncated, infos

    def reset(self) -> tuple[Array, dict[str, Any]]:
        """Resets all environments and waits for the result; only for batch_size = num_envs.

        Returns:
            Observations (num_envs, n), and infos in the format of `recv`.

        Raises:
            RuntimeError: batch_size is not num_envs.
        """
        if self.is_async:
            raise RuntimeError("reset is for batch_size = num_envs: call async_reset, and recv for each batch")
        self.async_reset()
        observation, _, _, _, infos = self.recv()
        return observation, infos

    def step(self, action: ArrayLike, env_id: ArrayLike | None = None) -> Result:
        """Calls `send`, then `recv`.

        With more than one block, the result may be that of other environments than those of the actions. The entry "env_id" of the infos
        has the ids of the environments in the result.

        Args:
            action: Actions, (n, nu), in the units of the task.
            env_id: Ids of the environments of these actions, (n,) integers. None stands for all environments in ascending order.
        """
        self.send(action, env_id)
        return self.recv()

    def close(self) -> None:
        """Waits for pending steps and ends the worker threads. Later calls of `send` and `async_reset` raise ClosedEnvironmentError."""
        self._closed = True
        self._workers.shutdown()

    def _check_open(self, call: str) -> None:
        """Raises ClosedEnvironmentError, Gymnasium's, if the pool was closed; `call` is the name of the method."""
        if self._closed:
            raise ClosedEnvironmentError(f"{call} was called after close: call close last, or make another pool")

    def __enter__(self) -> StepperPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _begin(self, block: int, seed: int | None) -> Result:
        """Resets the environments of a block and returns a result in the format of `recv`, with rewards of 0.

        Args:
            block: Index of the block of environments.
            seed: Seed of the block's first environment; None continues the random numbers.
        """
        observation, infos = self._blocks[block].reset(seed=seed)
        never = np.zeros(self._size, dtype=bool)
        return observation, np.zeros(self._size), never, never.copy(), infos
