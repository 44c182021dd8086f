"""Random values of parameters: `uniform`, `log_uniform`, `scale` and `add`, for events of tasks and for `Stepper.randomize`."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper.shared.arguments import check_whole
from stepper.shared.streams import Rng, Streams

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Draw:
    """Random values of selected numbers, made by `uniform`, `log_uniform`, `scale` or `add`.

    Attributes:
        kind: How a random number becomes a value: the number itself, a factor of the model's value, or an addend of it.
        low: Lower bounds of the random numbers, a number or an array that broadcasts to the selected numbers.
        high: Upper bounds, in the same format.
        logarithmic: Whether the logarithm of a random number is uniform, and not the number.
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the random numbers in `Stepper.randomize`.
    """

    kind: Literal["value", "scale", "add"]
    low: Array
    high: Array
    logarithmic: bool = False
    shared: bool = False
    seed: int = 0

    def numbers(self, rng: Rng, shape: tuple[int, ...]) -> Array:
        """Random numbers for n environments, (n, *shape), in the unit of `low`."""
        drawn = rng.uniform(0.0, 1.0, 1 if self.shared else math.prod(shape))
        drawn = drawn.reshape(len(drawn), *([1] * len(shape) if self.shared else shape))
        low, high = (np.log(self.low), np.log(self.high)) if self.logarithmic else (self.low, self.high)
        numbers = low + drawn * (high - low)
        return np.broadcast_to(np.exp(numbers) if self.logarithmic else numbers, (len(drawn), *shape))

    def values(self, numbers: Array, reference: Array) -> Array:
        """Values (n, ...) of the selected numbers, from random numbers (n, ...) and the model's values (...), in the unit of the values."""
        if self.kind == "scale":
            return numbers * reference
        return numbers + reference if self.kind == "add" else numbers


def uniform(low: ArrayLike, high: ArrayLike, *, shared: bool = False, seed: int = 0) -> Draw:
    """Values that are uniform from `low` to `high`.

    Args:
        low: Lower bound, in the unit of the field: a number, or an array (k,) of the shape of the selected numbers.
        high: Upper bound, in the unit and format of `low`: a number or an array (k,).
        shared: Whether all selected numbers of an environment get the same value. Otherwise each number gets a value.
        seed: Seed of the values in `Stepper.randomize`. In a task they follow from the seed of each environment instead.

    Raises:
        ValueError: A bound is not finite, or `low` is above `high`.
    """
    return _draw("uniform", "value", low, high, shared=shared, seed=seed)


def log_uniform(low: ArrayLike, high: ArrayLike, *, shared: bool = False, seed: int = 0) -> Draw:
    """Values whose logarithms are uniform, from `low` to `high`, which are positive.

    Args:
        low: Lower bound, in the unit of the field, above 0: a number, or an array (k,) of the shape of the selected numbers.
        high: Upper bound, in the unit and format of `low`: a number or an array (k,).
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the values in `Stepper.randomize`, as in `uniform`.

    Raises:
        ValueError: A bound is not finite or not above 0, or `low` is above `high`.
    """
    return _draw("log_uniform", "value", low, high, shared=shared, seed=seed)


def scale(low: ArrayLike, high: ArrayLike, *, shared: bool = False, seed: int = 0) -> Draw:
    """Values of the model times factors that are uniform from `low` to `high`.

    Args:
        low: Lower bound, without unit: a number, or an array (k,) of the shape of the selected numbers.
        high: Upper bound, in the unit and format of `low`: a number or an array (k,).
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the values in `Stepper.randomize`, as in `uniform`.

    Raises:
        ValueError: A bound is not finite, or `low` is above `high`.
    """
    return _draw("scale", "scale", low, high, shared=shared, seed=seed)


def add(low: ArrayLike, high: ArrayLike, *, shared: bool = False, seed: int = 0) -> Draw:
    """Values of the model plus addends that are uniform from `low` to `high`.

    Args:
        low: Lower bound, in the unit of the field: a number, or an array (k,) of the shape of the selected numbers.
        high: Upper bound, in the unit and format of `low`: a number or an array (k,).
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the values in `Stepper.randomize`, as in `uniform`.

    Raises:
        ValueError: A bound is not finite, or `low` is above `high`.
    """
    return _draw("add", "add", low, high, shared=shared, seed=seed)


def _draw(name: str, kind: Literal["value", "scale", "add"], low: ArrayLike, high: ArrayLike, *, shared: bool, seed: int) -> Draw:
    """Draw with checked bounds; `name` is the name of the function, for error messages."""
    bounds = (array_of(f"a bound of {name}", low), array_of(f"a bound of {name}", high))
    logarithmic = name == "log_uniform"
    check_whole(f"seed of {name}", seed, least=0)
    if not all(np.isfinite(bound).all() for bound in bounds) or np.any(bounds[0] > bounds[1]):
        raise ValueError(f"{name}({low!r}, {high!r}): the bounds must be finite numbers, the lower one first")
    if logarithmic and not np.all(bounds[0] > 0.0):
        raise ValueError(f"log_uniform({low!r}, {high!r}): the bounds must be above 0")
    return Draw(kind, bounds[0], bounds[1], logarithmic=logarithmic, shared=shared, seed=seed)


def present_rng(text: str, seed: int, envs: Array, values: Array) -> Rng:
    """Random number generator of environments for one selector of `Stepper.randomize`.

    The random numbers are a hash of the arguments. A stepper thus needs no further state, and a second draw gives other numbers.

    Args:
        text: The selector.
        seed: Seed of the draw.
        envs: Index of each environment, (n,).
        values: Present values of the selected numbers, (n, k).
    """
    streams, head = Streams(len(envs), 0), repr((text, int(seed))).encode()
    keys = [hashlib.blake2b(head + repr(int(env)).encode() + row.tobytes(), digest_size=8) for env, row in zip(envs, values, strict=True)]
    streams.seed(np.arange(len(envs)), [int.from_bytes(key.digest(), "little") for key in keys])
    return Rng(streams, np.arange(len(envs)))
