"""View of a batch of environments, from which tasks, controllers and measures read: base class of `TaskView` and `World`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np
from numpy.typing import NDArray

from stepper._quantities import read
from stepper._stepper import Model
from stepper.shared.streams import Rng, Streams

P = ParamSpec("P")
Array = NDArray[Any]


class BatchView:
    """View of a batch of environments, with the quantities of `Stepper` as attributes, (num_envs, ...) each. Abstract.

    Tasks get a `stepper.envs.TaskView`. Controllers and measures of studies get a `stepper.lab.World`. Functions of
    `stepper.envs.quantities` take both.

    Attributes:
        model: Model of the scene.
        num_envs: Number of environments.
        default_qpos: Reference configuration, (nq,), m and rad: that of the keyframe in which episodes begin, or `qpos0` of the model.
    """

    model: Model
    num_envs: int
    default_qpos: Array
    _streams: Streams

    if TYPE_CHECKING:  # Both classes look up the quantities of their engine.

        def __getattr__(self, name: str) -> Any: ...

    def read(self, name: str, of: str | int | Sequence[str | int] | None = None) -> Array:
        """Returns values of a quantity for all or some elements, by name or index, (num_envs, n, ...), in its unit; see `Stepper.read`."""
        return read(self, name, of)

    def rng(self, name: str) -> Rng:
        """Returns a random number generator for all environments at this time: `uniform(low, high, k)` and `normal(k)`, (num_envs, k).

        Its numbers depend on the seed and the age of each environment, and on the name. The age is the number of actions and resets since
        the environment was seeded; in a study, the number of control periods of the episode. Calls at the same time with the same name give
        the same numbers, in batches of every size. In a study they are the same at every value of the parameters and with all settings.

        Args:
            name: Name of the random quantity, such as "height_scan" or "push".
        """
        return Rng(self._streams.fork(name), np.arange(self.num_envs))

    def stored(self) -> dict[str, Any]:
        """Returns values that were computed from the present state, by name, in which `per_moment` stores more."""
        raise NotImplementedError


def per_moment(function: Callable[P, Array]) -> Callable[P, Array]:
    """Decorator for a function of a `BatchView`, or a method of a task: the result is computed once per state, and stored."""
    name = f"of {function.__module__}.{function.__qualname__}"

    @functools.wraps(function)
    def quantity(*arguments: P.args, **named: P.kwargs) -> Array:
        view: Any = arguments[-1]
        values = view.stored()
        if name not in values:
            values[name] = function(*arguments, **named)
        value: Array = values[name]
        return value

    return quantity
