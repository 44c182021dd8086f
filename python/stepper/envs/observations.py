"""Observations of a task: rows of observed quantities with their errors, observation groups, and the memory of delays and histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter, methodcaller
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import WrongArgumentError
from stepper.shared.arguments import check_number, check_takes, check_whole, in_words
from stepper.shared.draws import Draw
from stepper.shared.fields import COMPOUNDS, RANDOMIZED
from stepper.shared.streams import Rng, Streams

if TYPE_CHECKING:
    from stepper.envs.task import TaskView

Array = NDArray[Any]
Error = float | Draw
"""Type of an observation error: half width of a uniform error, or random values."""


@dataclass(frozen=True)
class Observation:
    """One observed quantity of a task, a row in the table that `Task.observations` returns. The observation concatenates all rows.

    The quantity passes through `columns`, `bias`, `noise`, `clip`, `scale`, `delay` and `history`, in this order.

    Attributes:
        name: Name of the row. Without `func` it names a command of the task, or a quantity of `TaskView` such as "qpos" or "action". A
            selector such as "geom_friction[*_foot][0]" observes parameters. A function in this place is `func`, and its name that of the
            row.
        func: Function of a `TaskView` that computes the quantity, (num_envs, ...), in place of a quantity of `Stepper`.
        columns: Columns of the flattened quantity (num_envs, n) that are observed; None selects all columns.
        clip: Lower and upper bound of the observed values; None means no bound.
        noise: Error that is drawn for each observation. A number is the half width of uniform noise, in the unit of the quantity. Values
            of `uniform`, `log_uniform` or `normal` are added. The quantity is multiplied by values of `scale`.
        scale: Factor of the observed values.
        unit: Unit of the values of `func`, for documentation; empty for numbers without a unit, and for quantities of `Stepper`.
        bias: Error in the format of `noise` that is drawn for each episode, and stays.
        delay: Delay in actions, a number or the smallest and the largest one. Each episode draws it. Before the delay has passed, the first
            observation of the episode is observed.
        history: Number of observations that the row has: the last ones, the oldest first. The first observation of an episode stands for
            earlier ones.
    """

    name: Any
    func: Callable[[Any], Array] | None = None
    columns: slice | None = None
    clip: tuple[float, float] | None = None
    noise: Error = 0.0
    scale: float = 1.0
    unit: str = ""
    bias: Error = 0.0
    delay: int | tuple[int, int] = 0
    history: int = 1

    def __post_init__(self) -> None:
        if callable(self.name) and self.func is None:
            object.__setattr__(self, "func", self.name)
            object.__setattr__(self, "name", getattr(self.name, "__name__", "").strip("_<>"))
        if not isinstance(self.name, str):
            raise WrongArgumentError(f"the name of an Observation is {in_words(self.name)}, must be a text: Observation(name, func=...)")
        if self.func is not None and not callable(self.func):
            raise WrongArgumentError(f"func of Observation {self.name!r} is {in_words(self.func)}, must be a function of now, or None")
        if self.func is not None:
            check_takes(self.func, ["now"], f"func of Observation {self.name!r}")
        for name, error in (("noise", self.noise), ("bias", self.bias)):
            if not isinstance(error, Draw):
                check_number(f"{name} of Observation {self.name!r}", error, least=0.0)
        check_number(f"scale of Observation {self.name!r}", self.scale)
        check_whole(f"history of Observation {self.name!r}", self.history, least=1)
        if len(self.delays) != 2 or not all(isinstance(end, int) for end in self.delays) or not 0 <= self.delays[0] <= self.delays[1]:
            raise ValueError(f"delay of Observation {self.name!r} is {self.delay!r}, must be a whole number or a tuple of two, in order")
        if self.clip is not None and (np.shape(self.clip)[:1] != (2,) or np.any(np.greater(*self.clip))):
            raise ValueError(f"clip of Observation {self.name!r} is {self.clip!r}, must be the lower bound and then the upper bound")

    @property
    def delays(self) -> tuple[int, int]:
        """Smallest and largest delay, in actions."""
        return self.delay if isinstance(self.delay, tuple) else (self.delay, self.delay)

    @property
    def frames(self) -> int:
        """Number of observations that the row remembers, the present one among them."""
        return self.history + self.delays[1]

    def quantity(self, now: TaskView) -> Array:
        """Returns the quantity that this row observes, (num_envs, ...), in its unit, without columns and errors."""
        value: Array = (self.func or self._function(now.task))(now)
        return value

    def _function(self, task: Any) -> Callable[[Any], Array]:
        """Function of a `TaskView` for the quantity that the name stands for in a task: a command, a parameter or another quantity."""
        if self.name in task.commands:
            return methodcaller("command", self.name)
        is_parameter = self.name.partition("[")[0].strip() in _PARAMETERS
        return methodcaller("parameter", self.name) if is_parameter else attrgetter(self.name)

    def read(self, now: TaskView, bias: Array | None = None) -> Array:
        """Returns the values of this row of the observation table, (num_envs, n), in its unit, with errors and before `clip`.

        Args:
            now: View of the batch.
            bias: Errors of the episodes from `bias`, (num_envs, n), in the unit of the row or as factors; None means none.
        """
        value = self.quantity(now) if self.func is None else self.func(now)
        flat = value if value.ndim == 2 else value.reshape(len(value), -1)
        flat = flat if self.columns is None else flat[:, self.columns]
        flat = flat if bias is None else _with_error(flat, self.bias, bias)
        return _with_error(flat, self.noise, draw_error(self.noise, now.rng(self.name), flat.shape[1])) if self.noise else flat


_PARAMETERS = {**RANDOMIZED, **COMPOUNDS}
"""Fields of `Stepper.randomize`, which selectors of observed parameters begin with."""


def draw_error(error: Error, rng: Rng, size: int) -> Array:
    """Random errors of n environments, (n, size): addends in the unit of the quantity, or factors."""
    return error.numbers(rng, (size,)) if isinstance(error, Draw) else rng.uniform(-error, error, size)


def _with_error(values: Array, error: Error, drawn: Array) -> Array:
    """Values (num_envs, n) with errors that `draw_error` has drawn, (num_envs, n)."""
    made: Array = values * drawn if isinstance(error, Draw) and error.kind == "scale" else values + drawn
    return made


@dataclass(frozen=True)
class Group:
    """Observation group, a value of the dictionary that `Task.observations` may return.

        {"policy": rows, "critic": Group(rows, noise=False, extra=(Observation(foot_forces),))}

    Attributes:
        rows: Rows of the group, which other groups may have too. Rows of the same name have the same noise in all groups.
        noise: Whether the rows have their errors. False removes `noise`, `bias` and `delay` from all rows.
        extra: Further rows.
    """

    rows: tuple[Observation, ...]
    noise: bool = True
    extra: tuple[Observation, ...] = ()

    def table(self) -> tuple[Any, ...]:
        """Rows of the group, without errors if `noise` is False."""
        rows = (*self.rows, *self.extra)
        if self.noise:
            return rows
        return tuple(replace(row, noise=0.0, bias=0.0, delay=0) if isinstance(row, Observation) else row for row in rows)


class RowMemory:
    """Errors and earlier values of a row of the observation table in the running episodes.

    Args:
        row: The row.
        num_envs: Number of environments.
        size: Number of columns of one observation.

    Attributes:
        bias: Errors of the episodes, (num_envs, size).
        delay: Delay of each environment in actions, (num_envs,).
        values: Last values, the newest one last, (num_envs, frames, size).
        count: Number of values of the episode, (num_envs,), of which more than 1 count as 2.
        ages: Age of each environment at its newest value, (num_envs,) uint64; see `Streams`.
    """

    def __init__(self, row: Observation, num_envs: int, size: int):
        self._error, self._delays, self._history, self._name = row.bias, row.delays, row.history, row.name
        self.bias = np.zeros((num_envs, size))
        self.delay = np.full(num_envs, row.delays[0])
        self.values = np.zeros((num_envs, row.frames, size))
        self.count, self.ages = np.zeros(num_envs, dtype=np.int64), np.zeros(num_envs, dtype=np.uint64)

    def begin(self, envs: Array, streams: Streams) -> None:
        """Draws bias and delay of new episodes of the environments `envs`, indices (n,), and forgets their values."""
        self.count[envs] = 0
        rng = Rng(streams.fork(f"memory of {self._name}"), envs)
        if self._error:
            self.bias[envs] = draw_error(self._error, rng, self.bias.shape[1])
        low, high = self._delays
        if high > low:
            self.delay[envs] = low + (rng.uniform(0.0, high - low + 1, 1)[:, 0]).astype(np.int64)

    def remember(self, values: Array, ages: Array) -> Array:
        """Stores present values, and returns the observed ones. Values that are stored again at the same age replace the newest ones.

        Args:
            values: Present values of the row, (num_envs, size), in its unit.
            ages: Ages of the environments, (num_envs,), a number of actions and resets.

        Returns:
            Delayed values and their history, (num_envs, n), in the unit of the row.
        """
        is_next = (ages != self.ages) | (self.count == 0)
        self.count += is_next
        self.ages[:] = ages
        np.minimum(self.count, 2, out=self.count)
        if (older := is_next & (self.count == 2)).any():
            self.values[older, :-1] = self.values[older, 1:]
        self.values[:, -1] = values
        first = self.count == 1
        self.values[first] = values[first, None]
        newest = self.values.shape[1] - 1
        frames = newest - self.delay[:, None] + np.arange(1 - self._history, 1)
        observed: Array = self.values[np.arange(len(values))[:, None], frames]
        return observed.reshape(len(values), -1)
