"""Terms of a reward: weighted functions of the view of the batch, and their sums over each episode."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import WrongArgumentError, did_you_mean_or_all

Array = NDArray[Any]


class Reward:
    """Term of a reward, a value of the dictionary that `Task.rewards` returns.

        Reward(track_velocity, 2.0, std=0.5)  # 2 track_velocity(now, std=0.5) dt

    Args:
        func: Function of a `TaskView` that returns the term without its weight, (num_envs,).
        weight: Weight. A term of weight 0 is not computed.
        per_second: Whether the weight is per second, so that the term is also multiplied by the time of an action (s).
        **arguments: Further arguments of `func`.

    Raises:
        TypeError: `func` is no function.
        ValueError: The weight is not a finite number.
    """

    def __init__(self, func: Callable[..., Array], weight: float = 1.0, *, per_second: bool = True, **arguments: Any):
        if not callable(func):
            raise WrongArgumentError(f"func of a Reward is {func!r}, must be a function of now: Reward(height, 1.0)")
        self.func, self.weight, self.per_second, self.arguments = func, _finite("the weight of a Reward", weight), per_second, arguments

    def __repr__(self) -> str:
        more = "".join(f", {name}={value!r}" for name, value in self.arguments.items())
        name = getattr(self.func, "__qualname__", repr(self.func))
        return f"Reward({name}, {self.weight!r}{'' if self.per_second else ', per_second=False'}{more})"


def _finite(name: str, value: Any) -> float:
    """A finite number as a float; a ValueError with the `name` of the value otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, must be a finite number")
    return float(value)


class RewardTerms:
    """Terms of a task's reward with their weights, and their sums over the running episodes.

    Args:
        task: Name of the task's class, for error messages.
        terms: Result of `Task.rewards`.
        weights: Weights that replace those of the terms, by name; None replaces none.
        dt: Time of an action, s.
        num_envs: Number of environments.

    Attributes:
        weights: Weight of each term, by name.
        sums: Sum of each weighted term over the running episodes, (num_envs,) by name.

    Raises:
        TypeError: The terms are no dictionary of `Reward`, or the weights are no mapping.
        ValueError: A weight belongs to no term, or is not finite.
    """

    def __init__(self, task: str, terms: Any, weights: Mapping[str, float] | None, *, dt: float, num_envs: int):
        if not isinstance(terms, Mapping) or not all(isinstance(term, Reward) for term in terms.values()):
            raise WrongArgumentError(
                f'{task}.rewards returns {terms!r}, must return terms by name: return {{"upright": Reward(upright, 1.0)}}'
            )
        if not isinstance(weights, Mapping | None):
            raise TypeError(f'rewards is {weights!r}, must be weights by name of the term, as {{"upright": 2.0}}, or None')
        self._task, self._terms = task, dict(terms)
        self.weights = {name: term.weight for name, term in self._terms.items()}
        for name, weight in (weights or {}).items():
            if name not in self._terms:
                none = f"; {task} has no method `rewards`, whose terms have weights"
                hint = did_you_mean_or_all(name, list(self._terms)) if self._terms else none
                raise ValueError(f"rewards has {name!r}, which is no term of the reward of {task}{hint}")
            self.weights[name] = _finite(f"rewards[{name!r}]", weight)
        self._factors = {name: self.weights[name] * (dt if term.per_second else 1.0) for name, term in self._terms.items()}
        self.sums = {name: np.zeros(num_envs) for name, weight in self.weights.items() if weight}

    def values(self, now: Any) -> dict[str, Array]:
        """Weighted terms after a step, (num_envs,) by name; those of weight 0 are absent."""
        found = {}
        for name, total in self.sums.items():
            term = self._terms[name]
            value = term.func(now, **term.arguments)
            if not isinstance(value, np.ndarray) or value.shape != total.shape:
                shape = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else repr(value)
                raise ValueError(
                    f"the term {name!r} of {self._task}.rewards returns {shape}, must return an array {total.shape}: one number for each "
                    "environment"
                )
            found[name] = self._factors[name] * value
        return found

    def __getstate__(self) -> dict[str, Any]:
        # Functions such as lambdas do not pickle; `Batch.__setstate__` reads the terms of the task again.
        return {name: value for name, value in self.__dict__.items() if name != "_terms"}

    def reattach(self, terms: Mapping[str, Reward]) -> None:
        """Sets the functions of the terms again after unpickling, from the result of `Task.rewards`."""
        self._terms = dict(terms)
