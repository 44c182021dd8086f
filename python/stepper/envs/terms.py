"""Declared parts of a task, with their state in all environments: reward terms, commands, events and actions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model, Stepper
from stepper.envs.actions import actions_of
from stepper.envs.commands import commands_of
from stepper.envs.events import Events
from stepper.envs.rewards import RewardTerms
from stepper.envs.task import Reset, Task, TaskView
from stepper.shared.streams import Rng, Streams

Array = NDArray[Any]


class TaskTerms:
    """Reward terms, commands, events and actions of a task in a batch of environments.

    Args:
        task: The task.
        sim: The stepper.
        streams: Random number streams of the environments.
        dt: Time of an action, s.
        weights: Weights that replace those of the reward terms, by name; None replaces none.

    Attributes:
        rewards: Reward terms with their sums.
        actions: Conversion of actions to controls; None if the task has no `actions`.
        commands: Commands by name.
        drawn: Random numbers of the present commands, (num_envs, size) by name.
    """

    def __init__(self, task: Task, sim: Stepper, streams: Streams, dt: float, weights: Mapping[str, float] | None):
        num_envs, kind = sim.num_envs or 1, type(task).__name__
        self._task, self._streams, self._dt = task, streams, dt
        self.rewards = RewardTerms(kind, task.rewards(), weights, dt=dt, num_envs=num_envs)
        self.events = Events(kind, task.events(), sim, dt)
        self.actions = actions_of(task, sim.model)
        self.commands = commands_of(task)
        self.drawn = {name: np.zeros((num_envs, command.size)) for name, command in self.commands.items()}
        self._left = {name: np.zeros(num_envs, dtype=np.int64) for name, command in self.commands.items() if command.every is not None}
        self.delay = np.zeros(num_envs, dtype=np.int64)

    def begin(self, reset: Reset, is_seeded: Array) -> None:
        """Draws commands, delays and parameters of new episodes. Their random numbers do not change those of `reset.rng`.

        Args:
            reset: The environments that start an episode.
            is_seeded: Environments that have got a new seed, (n,) bool.
        """
        for total in self.rewards.sums.values():
            total[reset.envs] = 0.0
        if not (self.events or self.commands or self.actions):
            return
        rng = Rng(self._streams.fork("events"), reset.envs)
        self.events.begin(reset, is_seeded, rng)
        if self.actions is not None:
            low, high = self.actions.delays
            self.delay[reset.envs] = (low + rng.uniform(0.0, 1.0, 1)[:, 0] * (high - low + 1)).astype(np.int64)
        self._draw(reset.envs, list(self.commands), "commands")

    def _draw(self, envs: Array, names: list[str], stream: str) -> None:
        """Draws commands of the environments `envs`, indices (n,), and the number of actions for which they hold."""
        if not names:
            return
        rng = Rng(self._streams.fork(stream), envs)
        for name in names:
            command = self.commands[name]
            self.drawn[name][envs] = command.draw(rng, self._streams.ages[envs])
            if command.every is not None:
                seconds = rng.uniform(*command.every, 1)[:, 0]
                self._left[name][envs] = np.maximum(1, np.round(seconds / self._dt)).astype(np.int64)

    def make_events(self, sim: Stepper, begins: Array | None) -> None:
        """Makes the events that are due before an action. `begins` are environments that are reset in this step, (num_envs,), or None."""
        if self.events.left:
            present = lambda envs: Reset(sim, envs, {}, Rng(self._streams, envs), present=True)  # noqa: E731
            self.events.advance(present, lambda: self._streams.fork("interval"), begins)

    def redraw_commands(self, over: Array, begins: Array | None) -> bool:
        """Draws commands whose time is over again, and returns whether there was one.

        Args:
            over: Environments whose episode has ended, (num_envs,) bool; they keep their commands.
            begins: Environments that were reset in this step, (num_envs,) bool; None means no environment.
        """
        redrawn = False
        for name, left in self._left.items():
            np.subtract(left, 1 if begins is None else ~begins, out=left)
            is_due = (left <= 0) & ~over
            if is_due.any():
                self._draw(np.flatnonzero(is_due), [name], f"command {name}")
                redrawn = True
        return redrawn

    def step(self, now: TaskView, action: Array, before: Array, frame_skip: int) -> None:
        """Steps the simulation by an action.

        Args:
            now: View of the batch.
            action: Actions, (num_envs, n).
            before: Actions before them, (num_envs, n), which act during the delay.
            frame_skip: Number of time steps.
        """
        if self.actions is None:
            now._step(action, frame_skip)
            return
        controls = self.actions.controls(now, action)
        if not self.actions.delays[1]:
            now._step(controls, frame_skip)
            return
        held = self.actions.controls(now, before)
        for k in range(frame_skip):
            now._step(np.where((self.delay > k)[:, None], held, controls))

    def __getstate__(self) -> dict[str, Any]:
        # Functions of the task may not pickle; `reattach` reads them again.
        return {name: value for name, value in self.__dict__.items() if name not in ("actions", "commands")}

    def reattach(self, model: Model) -> None:
        """Reads functions of the task again after unpickling."""
        self.rewards.reattach(self._task.rewards())
        self.events.reattach(self._task.events(), model)
        self.actions, self.commands = actions_of(self._task, model), commands_of(self._task)
