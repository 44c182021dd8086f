"""Observation groups of a task in a batch of environments: spaces, arrays, and the memory of their rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from stepper.envs.observations import RowMemory
from stepper.envs.task import Task, TaskView
from stepper.envs.task_results import POLICY, Table, tables_of
from stepper.shared.streams import Streams

Array = NDArray[Any]
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
        self._tables = self._read_tables(task, now)
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

    def _read_tables(self, task: Task, now: TaskView) -> dict[str, Table]:
        """Tables of the groups that observations have, by name."""
        tables = tables_of(task, now)
        return tables if self._all else {POLICY: tables[POLICY]}

    def reattach(self, task: Task, now: TaskView) -> None:
        """Reads the tables of the task again after unpickling, because functions such as lambdas do not pickle."""
        self._tables = self._read_tables(task, now)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_tables"}

    def begin(self, envs: Array) -> None:
        """Draws errors and delays of new episodes of the environments `envs`, indices (n,)."""
        for memory in self._memories.values():
            memory.begin(envs, self._streams)

    def read(self, now: TaskView) -> Any:
        """Observations of all environments in a new array, (num_envs, n), or a dictionary of such arrays by group."""
        found = {group: self._read_group(now, group, table) for group, table in self._tables.items()}
        return found if self._all else found[POLICY]

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
