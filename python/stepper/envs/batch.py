"""Episodes of a task in many environments: what single and vector environments have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from stepper._options import Options, Precision
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.envs.streams import Draws, Streams
from stepper.envs.task import Array, Contact, Moment, Quantity, Task, Terms
from stepper.envs.tasks import TASKS
from stepper.quantities import room

_NON_FINITE = np.uint32(Status.NON_FINITE)


class Batch:
    """Episodes of a task in `num_envs` environments of one `Stepper`.

    Args:
        task: A task, or the class of one, or the name of one of `stepper.envs.TASKS`.
        num_envs: Number of environments.
        arguments: The task's arguments, where it is given by its class or name.
        contact: Law of contact: "mujoco" is `Options.of(model)`, "hard" is `Options()`; None is the task's.
        options: Settings of the step in place of those of `contact`.
        precision: "f64" or "f32".
        threads: Threads that step; 0 is all that this process may use. The bits are the same for any number.
        dtype: Scalar type of observations; None is that of the precision.
        max_episode_steps: Actions after which an episode is truncated; None is no limit.
        model: What `task.model()` makes, where it is made already.

    Raises:
        ValueError: No task of that name; a law, type or number that is none.
        TypeError: Arguments that the task does not have.
    """

    def __init__(
        self,
        task: Task | type[Task] | str,
        num_envs: int,
        arguments: dict[str, Any],
        *,
        contact: Contact | None = None,
        options: Options | None = None,
        precision: Precision = "f64",
        threads: int = 1,
        dtype: Any = None,
        max_episode_steps: int | None = None,
        model: Model | None = None,
    ):
        self.task = task = made_task(task, arguments)
        model = task.model() if model is None else model
        law = _options(model, contact or task.contact, options)
        sensors = task.sensors()
        settings: dict[str, Any] = {"options": law, "precision": precision, "threads": threads}
        self.sim = Stepper(model, num_envs, **settings, sensors=sensors, actuators=task.actuators())
        self._has_noise = sensors is not None
        # Seeds of the errors of sensors, and which environments have not begun under theirs yet.
        self._noise_seeds, self._new_seeds = np.full(num_envs, _word(), dtype=np.uint64), np.full(num_envs, self._has_noise)
        self.num_envs, self.dt = num_envs, self.sim.timestep * task.frame_skip
        self.dtype = np.dtype(dtype if dtype is not None else {"f64": np.float64, "f32": np.float32}[precision])
        if self.dtype not in (np.float64, np.float32):
            raise ValueError(f"dtype is {self.dtype}, must be float64 or float32")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps is {max_episode_steps}, must be at least 1, or None for no limit")
        self._limit = max_episode_steps
        self.streams = Streams(num_envs, _word())
        self.returns, self.lengths = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64)
        self._rest, self._memory = model.qpos0, task.memory(num_envs)
        self._qpos, self._qvel = np.tile(model.qpos0, (num_envs, 1)), np.zeros((num_envs, model.nv))
        low, high = task.action_bounds(model)
        self._still = np.zeros((num_envs, len(low)))
        self.now = self._moment(self._still)
        self._position = task.position(self.now)
        self._rows = self._table()
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = Box(-np.inf, np.inf, (self._rows[-1][1].stop,), dtype=self.dtype.type)

    def _moment(self, action: Array) -> Moment:
        return Moment(self.sim, self.task, self.dt, action, self._rest, memory=self._memory)

    def _table(self) -> list[tuple[Quantity, slice]]:
        """Rows of the task's table, and their places in the observation."""
        rows, at = [], 0
        for quantity in self.task.quantities():
            width = quantity.read(self.now).shape[1]
            rows.append((quantity, slice(at, at + width)))
            at += width
        return rows

    @property
    def structure(self) -> dict[str, int]:
        """How many numbers of the observation each row of the task's table has."""
        return {quantity.name: rows.stop - rows.start for quantity, rows in self._rows}

    def seed(self, envs: Array, seeds: Sequence[int]) -> None:
        """Starts the random numbers of the environments `envs` (n,) anew.

        Errors of sensors have numbers of their own, which follow from the seed of an environment and from its place.
        """
        self.streams.seed(envs, seeds)
        if self._has_noise:
            self._noise_seeds[envs], self._new_seeds[envs] = [_word(seed) for seed in seeds], True

    def begin(self, mask: Array) -> None:
        """Begins an episode in the environments of a mask, (num_envs,) bool."""
        self._place(mask, np.flatnonzero(mask))
        self.now = self._moment(self._still) if mask.all() else self.now
        self.now.renew(mask)
        self._position = self.task.position(self.now)

    def _place(self, mask: Array, envs: Array) -> None:
        """Begins an episode in the environments of a mask, whose indices are `envs`, and reads nothing."""
        qpos, qvel = np.empty((len(envs), len(self._rest))), np.zeros((len(envs), self._qvel.shape[1]))
        qpos[:] = self._rest
        self.task.start(qpos, qvel, Draws(self.streams, envs))
        self._qpos[envs], self._qvel[envs] = qpos, qvel
        new = mask & self._new_seeds
        if new.any():
            self.sim.reset(new, qpos=self._qpos, qvel=self._qvel, seed=self._noise_seeds)
            self._new_seeds[envs] = False
        rest = mask & ~new
        if rest.any():
            self.sim.reset(rest, qpos=self._qpos, qvel=self._qvel)
        self.task.prepare(self.sim, self._memory, mask, Draws(self.streams, envs))
        self.returns[envs], self.lengths[envs] = 0.0, 0

    def set_state(self, qpos: Array, qvel: Array, mask: Array | None = None) -> None:
        """Sets configurations (num_envs, nq) and velocities (num_envs, nv), of all environments or those of a mask. Episodes go on."""
        self.sim.set_state(qpos, qvel, mask)
        self.now = self._moment(self._still)
        self._position = self.task.position(self.now)

    def step(self, action: Array, begins: Array | None = None) -> tuple[Array, Array, Array, Terms]:
        """Makes the steps of an action.

        Args:
            action: (num_envs, n) float64, nu numbers unless the task has bounds of its own.
            begins: Environments that begin an episode in place of it, (num_envs,) bool; None is none.

        Returns:
            Rewards (num_envs,) float64; which episodes are terminated and truncated, (num_envs,) bool; terms of the rewards. Rows of
            environments that begin are zero, but in the terms.
        """
        task, now = self.task, self._moment(action)
        self.now = now
        task.advance(now)
        status: Array = now.status
        self.lengths += 1
        beginning = None
        if begins is not None:
            beginning = np.flatnonzero(begins)
            self._place(begins, beginning)
            now.renew(begins)
        position = task.position(now)
        if position is not None:
            now.velocity = position - self._position
            now.velocity /= self.dt
        self._position = position
        rewards, terms = task.reward(now)
        reward = np.array(rewards, dtype=np.float64)
        over = task.terminated(now)
        terminated = np.zeros(self.num_envs, dtype=bool) if over is None else np.array(over)
        truncated = np.zeros(self.num_envs, dtype=bool) if self._limit is None else self.lengths >= self._limit
        if np.bitwise_or.reduce(status) & _NON_FINITE:
            failed = (status & _NON_FINITE) != 0
            terminated |= failed
            terms = terms | {"non_finite": failed}
        if beginning is not None:
            for ended in (reward, terminated, truncated):
                ended[beginning] = 0
        self.returns += reward
        return reward, terminated, truncated, terms

    def info(self) -> Terms:
        """What info says after a reset and after a step."""
        return self.task.info(self.now)

    def room(self, out: Array | None = None) -> Array:
        """An array for observations, (num_envs, n): `out` if it is given, or a new one.

        Raises:
            ValueError: An `out` of another shape or type.
        """
        return room((self.num_envs, *self.observation_space.shape), self.dtype, out)

    def observation(self, out: Array | None = None) -> Array:
        """The observation, (num_envs, n), written to an array of `room`: a new one by default."""
        out = self.room() if out is None else out
        for quantity, rows in self._rows:
            value = quantity.read(self.now)
            if quantity.clip is None:
                out[:, rows] = value
            else:
                np.clip(value, *quantity.clip, out=out[:, rows], casting="same_kind")
        return out

    def __getstate__(self) -> dict[str, Any]:
        # The table may have functions without a name, which do not pickle.
        return {name: value for name, value in self.__dict__.items() if name != "_rows"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state
        self._rows = self._table()


def made_task(task: Task | type[Task] | str, arguments: dict[str, Any]) -> Task:
    """The task itself, or one of a class or a name with the arguments given."""
    if isinstance(task, Task):
        if arguments:
            raise TypeError(f"{type(task).__name__} is made already: give {sorted(arguments)} to it, not to the environment")
        return task
    if isinstance(task, type) and issubclass(task, Task):
        return task(**arguments)
    if task not in TASKS:
        raise ValueError(f"there is no task {task!r}, there are: {', '.join(sorted(TASKS))}; or give a stepper.envs.Task")
    return TASKS[task](**arguments)


def _word(seed: int | None = None) -> int:
    """A word of 64 bits that follows from a seed, or from chance."""
    word: int = np.random.SeedSequence(seed).generate_state(1, np.uint64).item()
    return word


def _options(model: Model, contact: str, options: Options | None) -> Options:
    """Settings of the step."""
    if options is not None:
        return options
    if contact not in ("mujoco", "hard"):
        raise ValueError(f'contact is {contact!r}, must be "mujoco" or "hard"')
    return Options.of(model) if contact == "mujoco" else Options()
