"""Steps and resets of a task in many environments, shared by the single environment `StepperEnv` and by `StepperVectorEnv`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from gymnasium.spaces import Box, Dict

from stepper._options import Options, Precision, precision_of
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.envs.observations import RowMemory
from stepper.envs.task import Array, Contact, Reset, Task, TaskView, Terms, revision_of, with_zero_rows
from stepper.envs.task_results import (
    POLICY,
    EpisodeState,
    Table,
    bounds_of,
    call_hook,
    check_methods,
    episode_state_of,
    infos_of,
    model_of,
    position_of,
    rewards_of,
    rows_of,
    tables_of,
)
from stepper.envs.terms import TaskTerms
from stepper.loading import ModelWarning
from stepper.shared.arguments import check_fields, check_number, check_whole
from stepper.shared.streams import Rng, Streams

T = TypeVar("T")


class ObservationGroups:
    """Observations of a task in a batch of environments.

    Args:
        task: The task.
        now: View of the batch.
        streams: Random number streams of the environments.
        dtype: Scalar type of observations.
        all_groups: Whether observations are a dictionary of all groups. Otherwise they are the group "policy", and others are not computed.

    Attributes:
        space: Space of the observation of one environment: a `Box`, or a `Dict` of them.
        structure: Number of columns in the observation for each row, by name and in order; or a dictionary of such dictionaries by group.
    """

    def __init__(self, task: Task, now: TaskView, streams: Streams, dtype: np.dtype[Any], *, all_groups: bool):
        self._streams, self._dtype, self._all = streams, dtype, all_groups
        self._num_envs = len(now.action)
        self.reattach(task, now)
        self._shapes = {name: (self._num_envs, table[-1][1].stop) for name, table in self._tables.items()}
        boxes: dict[str, Any] = {name: Box(-np.inf, np.inf, shape[1:], dtype=dtype.type) for name, shape in self._shapes.items()}
        self.space: Any = Dict(boxes) if all_groups else boxes[POLICY]
        sizes = {name: {row.name: columns.stop - columns.start for row, columns in table} for name, table in self._tables.items()}
        self.structure: dict[str, Any] = sizes if all_groups else sizes[POLICY]
        self._memories = {
            f"{group}.{row.name}": RowMemory(row, self._num_envs, (columns.stop - columns.start) // row.history)
            for group, table in self._tables.items()
            for row, columns in table
            if row.bias or row.frames > 1
        }

    def reattach(self, task: Task, now: TaskView) -> None:
        """Reads the tables of the task, also after unpickling, because functions such as lambdas do not pickle."""
        tables = tables_of(task, now)
        self._tables = tables if self._all else {POLICY: tables[POLICY]}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_tables"}

    def begin(self, envs: Array) -> None:
        """Draws errors and delays of new episodes of the environments `envs`, indices (n,)."""
        for memory in self._memories.values():
            memory.begin(envs, self._streams)

    def read(self, now: TaskView) -> Any:
        """Observations of all environments in a new array, (num_envs, n), or a dictionary of such arrays by group."""
        if not self._all:
            return self._read_group(now, POLICY, self._tables[POLICY])
        return {group: self._read_group(now, group, table) for group, table in self._tables.items()}

    def _read_group(self, now: TaskView, group: str, table: Table) -> Array:
        """Observations of a group, (num_envs, n)."""
        out = np.empty(self._shapes[group], self._dtype)
        for row, columns in table:
            memory = self._memories.get(f"{group}.{row.name}") if self._memories else None
            value = row.read(now) if memory is None else row.read(now, memory.bias if row.bias else None)
            if memory is not None and row.frames > 1:
                value = value if row.clip is None else np.clip(value, *row.clip)
                out[:, columns] = memory.remember(value * row.scale, self._streams.ages)
                continue
            if row.clip is None:
                out[:, columns] = value
            else:
                np.clip(value, *row.clip, out=out[:, columns], casting="same_kind")
            if row.scale != 1.0:
                out[:, columns] *= row.scale
        return out


def each_group(observation: Any, function: Callable[[Array], T]) -> Any:
    """Result of a function of an array, or a dictionary of its results if the observation is a dictionary of arrays."""
    return {name: function(value) for name, value in observation.items()} if isinstance(observation, dict) else function(observation)


_NON_FINITE = np.uint32(Status.NON_FINITE)


class Batch:
    """Environments of a task on one `Stepper`, with their running episodes: steps, resets, observations, rewards and saved states.

    Args:
        task: The task.
        num_envs: Number of environments.
        contact: Contact law: "mujoco" is `Options.from_model(model)`, "hard" is `Options()`; None selects `task.contact`.
        options: Options of the step, in place of those of `contact`.
        precision: "f64" or "f32".
        threads: Number of threads; 0 uses all cores that this process may use. The results are the same, bit for bit, for any number.
        dtype: Scalar type of observations; None selects the type that `precision` names.
        max_episode_steps: Number of actions after which an episode is truncated; None selects `task.episode_seconds`.
        rewards: Weights that replace those of terms of the reward, by name; None replaces none.
        groups: Whether observations are a dictionary of all observation groups, and not the group "policy".
        model: Model of the scene; None calls `task.model()`.

    Raises:
        ValueError: An invalid contact, dtype or number.
        TypeError: A task without frame_skip.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int,
        *,
        contact: Contact | None = None,
        options: Options | None = None,
        precision: Precision = "f64",
        threads: int = 1,
        dtype: Any = None,
        max_episode_steps: int | None = None,
        rewards: Mapping[str, float] | None = None,
        groups: bool = False,
        model: Model | None = None,
    ):
        self.task = task
        check_methods(task)
        check_whole("num_envs", num_envs, least=1)
        if not hasattr(task, "frame_skip"):
            raise TypeError(f"{type(task).__name__} has no frame_skip, the number of steps per action: add the field `frame_skip: int = 1`")
        check_whole(f"frame_skip of {type(task).__name__}", task.frame_skip, least=1)
        if is_dataclass(task):
            check_fields(task)
            _check_defaults(task)
        model = model_of(task) if model is None else model
        law = _options(model, contact or task.contact, options)
        sensors = task.sensors()
        precision = precision_of(precision)
        settings: dict[str, Any] = {"options": law, "precision": precision, "threads": threads}
        self.sim = Stepper(model, num_envs, **settings, sensors=sensors, actuators=task.actuators())
        self._has_noise = sensors is not None
        self._noise_seeds = np.full(num_envs, _hashed_seed(), dtype=np.uint64)  # Seeds of the sensor errors.
        self.num_envs, self.dt = num_envs, self.sim.timestep * task.frame_skip
        dtype = _dtype_of(precision if dtype is None else dtype)
        if max_episode_steps is not None:
            check_whole("max_episode_steps", max_episode_steps, least=1)
        if max_episode_steps is None and task.episode_seconds is not None:
            check_number(f"episode_seconds of {type(task).__name__}", task.episode_seconds, above=0.0)
            max_episode_steps = max(1, round(task.episode_seconds / self.dt))
        self.max_episode_steps = max_episode_steps
        self.streams = Streams(num_envs, _hashed_seed())
        self.returns, self.lengths = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64)
        self._default_qpos = _default_qpos(task, model)
        self._episode_state = episode_state_of(task, num_envs, task.carried)
        self.terms = TaskTerms(task, self.sim, self.streams, self.dt, rewards)
        self._initial = {name: np.array(values) for name, values in self._episode_state.items()}
        self._seeded = np.ones(num_envs, dtype=bool)  # Environments whose seeds take effect at the next reset.
        low, high = bounds_of(task, model)
        if not len(low):
            _warn_without_actions(task, model)
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.clear_last_step()
        self.observations = ObservationGroups(task, self._now, self.streams, dtype, all_groups=groups)

    @property
    def now(self) -> TaskView:
        """View of all environments (`TaskView`) after the last step or reset, or after a later change of the stepper by the caller."""
        return self._now

    def clear_last_step(self) -> None:
        """Replaces the view `now` of all environments by one in which actions and `velocity` are zero, as before the first step."""
        shared = (self._default_qpos, self._episode_state, self.terms, self.streams)
        self._parts = (self.sim, self.task, self.dt, self.sim.model, self.num_envs, revision_of(self.sim.model), *shared)
        none = np.zeros((self.num_envs, *self.action_space.shape))
        self._now = TaskView(self._parts, none, none)
        position = position_of(self.task, self._now, self.num_envs)
        self._now.velocity = None if position is None else np.zeros_like(position)

    def _reread(self, changed: Array) -> None:
        """Replaces the view `now` after changes of some environments, a mask (num_envs,). Their action and velocity become zero."""
        last = self._now
        last._expire()
        self._now = TaskView(self._parts, with_zero_rows(last.action, changed), with_zero_rows(last.previous_action, changed))
        self._now.velocity = None if last.velocity is None else with_zero_rows(last.velocity, changed)
        self._now._flags = None if last._flags is None else with_zero_rows(last._flags, changed)
        self._now.reward_terms = {name: with_zero_rows(values, changed) for name, values in last.reward_terms.items()}

    def seed(self, envs: Array, seeds: Sequence[int]) -> None:
        """Seeds the random number generators of some environments.

        Sensor errors have separate generators, which depend on the seed and the index of an environment.

        Args:
            envs: Indices of the environments, (n,).
            seeds: Seeds of these environments, (n,).
        """
        self.streams.seed(envs, seeds)
        self._seeded[envs] = True
        if self._has_noise:
            self._noise_seeds[envs] = [_hashed_seed(seed) for seed in seeds]

    def begin(self, mask: Array) -> None:
        """Starts a new episode in the environments of a mask, (num_envs,) bool."""
        envs = np.flatnonzero(mask)
        self._end(envs)
        self.streams.ages[envs] += 1
        self._start(envs)
        self._reread(mask)

    def _end(self, envs: Array) -> None:
        """Calls the hook `Task.on_end` for those environments in `envs`, indices (n,), whose episode has at least one action."""
        if type(self.task).on_end is not Task.on_end and len(stepped := envs[self.lengths[envs] > 0]):
            call_hook(self.task, "on_end", self.now, stepped)

    def _start(self, envs: Array) -> None:
        """Starts episodes in the environments `envs`, indices (n,), and calls the hook `Task.reset`. The view `now` is not updated."""
        state = {name: values[envs] for name, values in self._initial.items()}
        for name in self.task.carried:
            running = ~self._seeded[envs]
            state[name][running] = self._episode_state[name][envs[running]]
        is_seeded = self._seeded[envs]
        episode_state = EpisodeState(type(self.task).__name__, state)
        reset = Reset(self.sim, envs, episode_state, Rng(self.streams, envs), default_qpos=self._default_qpos)
        self.terms.begin(reset, is_seeded)
        self.observations.begin(envs)
        call_hook(self.task, "reset", reset)
        for name, rows in reset.episode_state.items():
            self._episode_state[name][envs] = rows
        reset.apply(self._noise_seeds[envs] if self._has_noise else None, is_seeded)
        self._seeded[envs] = False
        self.returns[envs], self.lengths[envs] = 0.0, 0

    def set_state(self, qpos: Array | None, qvel: Array | None, mask: Array, envs: Array | None = None) -> None:
        """Sets positions (m, rad) and velocities (m/s, rad/s) of some environments; see `Stepper.set_state`.

        Args:
            qpos: Positions, (num_envs, nq), (k, nq) or (nq,), m and rad; None keeps them.
            qvel: Velocities, (num_envs, nv), (k, nv) or (nv,), m/s and rad/s; None keeps them.
            mask: The environments as a mask, (num_envs,) bool.
            envs: The environments as indices (k,), if `qpos` and `qvel` have one row per index; None if they have num_envs rows.
        """
        self.sim.set_state(qpos, qvel, mask if envs is None else envs)
        self._reread(mask)

    def step(self, action: Array, begins: Array | None = None) -> tuple[Array, Array, Array, Terms]:
        """Advances all environments by one action, which is `task.frame_skip` time steps.

        Args:
            action: Actions, (num_envs, n) float64, in the units of the task; n is nu unless the task has `action_bounds`.
            begins: Environments that are reset instead and ignore their action, (num_envs,) bool; None means no environment.

        Returns:
            rewards: (num_envs,) float64.
            terminated: (num_envs,) bool.
            truncated: (num_envs,) bool.
            terms: Entries for the info dict from `task.reward`, by name.

            The first three are zero in environments that are reset.

        Raises:
            ValueError: An action is not finite, and nothing was stepped; or a reward is not finite, after the steps.
        """
        task = self.task
        envs = None if begins is None else begins.nonzero()[0]
        action = np.array(action) if envs is None else with_zero_rows(action, envs)
        _check_actions(action, self.action_space)
        carried: Terms = {}
        if envs is not None:
            self._end(envs)
            carried = {name: self._episode_state[name][envs] for name in task.carried}
        self.terms.make_events(self.sim, begins)
        before = self._advance(action, envs)
        now = self._now
        # Only an override of `Task.advance` can make time steps that `TaskView.step` does not count.
        status = now.status if type(task).advance is not Task.advance or now._flags is None else now._flags
        if envs is not None:
            for name, values in carried.items():  # Environments that are reset ignore this action.
                self._episode_state[name][envs] = values
            self._start(envs)
            now._flags = None if now._flags is None else with_zero_rows(now._flags, envs)
        now.forget()
        if before is not None:
            now.velocity = (task.position(now) - before) / self.dt
            if envs is not None:
                now.velocity[envs] = 0.0
        now.reward_terms = self.terms.rewards.values(now)
        reward, terms = rewards_of(task, now, self.num_envs)
        ends = task.terminated(now)
        terminated = np.zeros(self.num_envs, dtype=bool) if ends is None else rows_of(task, "terminated", ends, bool, self.num_envs)
        truncated = np.zeros(self.num_envs, dtype=bool) if self.max_episode_steps is None else self.lengths >= self.max_episode_steps
        cut = task.truncated(now)
        if cut is not None:
            cut = rows_of(task, "truncated", cut, bool, self.num_envs)
        truncated = truncated if cut is None else truncated | cut
        if np.count_nonzero(status) and (failed := (status & _NON_FINITE) != 0).any():
            if begins is not None:
                failed &= ~begins
            terminated |= failed
            terms = terms | {"non_finite": failed}
            reward[failed & ~np.isfinite(reward)] = 0.0
        if envs is not None:
            for ended in (reward, terminated, truncated):
                ended[envs] = 0
        self._check_rewards(reward, action)
        self.returns += reward
        if now.reward_terms:
            terms = terms | self._sum_terms(begins)
        if self.terms.commands and self.terms.redraw_commands(terminated | truncated, begins):
            now.forget()
        return reward, terminated, truncated, terms

    def _advance(self, action: Array, envs: Array | None) -> Array | None:
        """Steps the simulation by actions, (num_envs, n), and returns `Task.position` before that. `envs` (n,) are reset afterwards."""
        last = self._now
        now = TaskView(self._parts, action, last.action if envs is None else with_zero_rows(last.action, envs))
        before = self.task.position(now)
        if before is not None:
            now.velocity = np.zeros(before.shape, before.dtype)
            now.forget()
        last._expire()
        self._now = now
        call_hook(self.task, "advance", now)
        self.lengths += 1
        self.streams.ages += 1
        return before

    def _sum_terms(self, begins: Array | None) -> Terms:
        """Adds the weighted reward terms of a step to their sums, and returns both as entries for the info dict.

        `begins` are environments that were reset in this step, (num_envs,) bool; None means no environment.
        """
        infos: Terms = {}
        for name, term in self._now.reward_terms.items():
            # Terms of environments whose next state would not have been finite can be NaN.
            value = term if _all_finite(term) else np.where(np.isfinite(term), term, 0.0)
            value = value if begins is None else with_zero_rows(value, begins)
            total = self.terms.rewards.sums[name]
            total += value
            infos[f"reward_{name}"], infos[f"return_{name}"] = value, total.copy()
        return infos

    def _check_rewards(self, reward: Array, action: Array) -> None:
        """Raises ValueError if a reward (num_envs,) is not finite. The message contains the environment and its action.

        `action` are the actions of all environments, (num_envs, n).
        """
        if not _all_finite(reward):
            env = np.flatnonzero(~np.isfinite(reward))[0]
            raise ValueError(
                f"the reward of environment {env} is {reward[env]} after the action {action[env].tolist()}: "
                f"return finite numbers from {type(self.task).__name__}.reward"
            )

    def info(self) -> Terms:
        """Extra fields of the info dict after reset and after step."""
        return infos_of(self.task, self._now, self.num_envs)

    def observation(self) -> Any:
        """Observations of all environments, (num_envs, n) or a dictionary of such arrays by group."""
        return self.observations.read(self._now)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state
        self.terms.reattach(self.sim.model)
        self.observations.reattach(self.task, self._now)


def _default_qpos(task: Task, model: Model) -> Array:
    """Reference configuration of a task, (nq,), m and rad: that of its keyframe, or of the model; a ValueError for an unknown keyframe."""
    if task.keyframe is None:
        return np.asarray(model.qpos0)
    if task.keyframe not in model.keyframe_names:
        known = ", ".join(model.keyframe_names) or "none"
        raise ValueError(
            f"{type(task).__name__}.keyframe is {task.keyframe!r}, which the model has not (it has {known}): give it "
            f'<key name="{task.keyframe}" qpos="..."/>'
        )
    return np.array(model.keyframe(task.keyframe).qpos)


def _check_defaults(task: Any) -> None:
    """Raises TypeError if a class gives a field of a dataclass another default in a way that Python's dataclasses ignore."""
    kind = type(task)
    for field in fields(task):
        if field.name in vars(task) and getattr(kind, field.name, field.default) is not field.default:
            raise TypeError(
                f"{kind.__name__} changes {field.name} of a dataclass without effect: write @dataclass(frozen=True, kw_only=True) above "
                f"the class, and the field with its type, {field.name}: {field.type} = {getattr(kind, field.name)!r}"
            )


def _all_finite(values: Array) -> bool:
    """Whether all numbers are finite."""
    # The sum of squares is a fast first test. If it is not finite, it may still come from finite numbers, by overflow.
    return math.isfinite(np.vdot(values, values)) or bool(np.isfinite(values).all())


def _check_actions(action: Array, space: Box) -> None:
    """Raises ValueError if an action, (num_envs, n), is not finite. The message has the environment, column and likely cause."""
    if not _all_finite(action):
        finite = np.isfinite(action)
        env, column = np.argwhere(~finite)[0]
        count = int((~finite).any(axis=1).sum())
        affected = f" ({count} of {len(action)} environments have NaN or infinite actions)" if len(action) > 1 else ""
        low, high = space.low[column], space.high[column]
        cause = "Check the policy's weights and its observations for NaN"
        if not (math.isfinite(low) and math.isfinite(high)):
            cause = (
                f"The bounds of this action are {low} to {high}, to which learners cannot scale: define finite ones by action_bounds(self, "
                "model) of the task, or by ctrlrange of the actuator in the model's file"
            )
        raise ValueError(
            f"the action of environment {env} is {action[env, column]} in column {column}{affected}; no environment was stepped. {cause}"
        )


def _warn_without_actions(task: Task, model: Model) -> None:
    """Issues a `ModelWarning` that a model has no actuators, so that actions have size 0."""
    name = f' "{model.name}"' if model.name else ""
    message = (
        f"{type(task).__name__}: the model{name} has no actuators, so actions have size 0 and no effect; add actuators to its file, "
        'or to a URDF with stepper.load(..., actuators="position")'
    )
    warnings.warn(message, ModelWarning, stacklevel=4)


def _dtype_of(value: Any) -> np.dtype[Any]:
    """NumPy type of observations, float64 or float32, from the argument `dtype`; a ValueError for any other type."""
    try:
        return np.dtype({"f64": np.float64, "f32": np.float32}[precision_of(value)])
    except ValueError:
        raise ValueError(f"dtype is {value!r}, must be np.float64 or np.float32") from None


def _hashed_seed(seed: int | None = None) -> int:
    """64-bit integer that is a hash of the seed, or a random 64-bit integer if the seed is None."""
    number: int = np.random.SeedSequence(seed).generate_state(1, np.uint64).item()
    return number


def _options(model: Model, contact: str, options: Options | None) -> Options:
    """Options of the step: `options` if they are given, otherwise those of the contact law "mujoco" or "hard"."""
    if options is not None:
        return options
    if contact not in ("mujoco", "hard"):
        raise ValueError(f'contact is {contact!r}, must be "mujoco" or "hard"')
    return Options.from_model(model) if contact == "mujoco" else Options()
