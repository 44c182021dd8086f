"""Random values of parameters and observation errors: `uniform`, `log_uniform`, `normal`, `scale` and `add`."""

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
    """Random values of selected numbers, made by `uniform`, `log_uniform`, `normal`, `scale` or `add`.

    Attributes:
        kind: How a random number becomes a value: the number itself, a factor of the model's value, or an addend of it.
        low: Lower bounds of the random numbers, a number or an array that broadcasts to the selected numbers; means of normal numbers.
        high: Upper bounds, in the same format. Standard deviations of normal numbers.
        distribution: Distribution of the random numbers: uniform, uniform in their logarithm, or normal.
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the random numbers in `Stepper.randomize`.
    """

    kind: Literal["value", "scale", "add"]
    low: Array
    high: Array
    distribution: Literal["uniform", "log_uniform", "normal"] = "uniform"
    shared: bool = False
    seed: int = 0

    def numbers(self, rng: Rng, shape: tuple[int, ...]) -> Array:
        """Random numbers for n environments, (n, *shape), in the unit of `low`."""
        size = 1 if self.shared else math.prod(shape)
        drawn = rng.normal(size) if self.distribution == "normal" else rng.uniform(0.0, 1.0, size)
        drawn = drawn.reshape(len(drawn), *([1] * len(shape) if self.shared else shape))
        if self.distribution == "normal":
            return np.broadcast_to(self.low + drawn * self.high, (len(drawn), *shape))
        is_log = self.distribution == "log_uniform"
        low, high = (np.log(self.low), np.log(self.high)) if is_log else (self.low, self.high)
        numbers = low + drawn * (high - low)
        return np.broadcast_to(np.exp(numbers) if is_log else numbers, (len(drawn), *shape))

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


def normal(mean: ArrayLike, std: ArrayLike, *, shared: bool = False, seed: int = 0) -> Draw:
    """Values with a normal distribution.

    Args:
        mean: Mean, in the unit of the field: a number, or an array (k,) of the shape of the selected numbers.
        std: Standard deviation, in the unit and format of `mean`, at least 0: a number or an array (k,).
        shared: Whether all selected numbers of an environment get the same random number.
        seed: Seed of the values in `Stepper.randomize`, as in `uniform`.

    Raises:
        ValueError: A number is not finite, or `std` is negative.
    """
    return _draw("normal", "value", mean, std, shared=shared, seed=seed)


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
    check_whole(f"seed of {name}", seed, least=0)
    is_finite = all(np.isfinite(bound).all() for bound in bounds)
    if name == "normal":
        if not is_finite or np.any(bounds[1] < 0.0):
            raise ValueError(f"normal({low!r}, {high!r}): the mean and the standard deviation must be finite, the latter at least 0")
        return Draw(kind, bounds[0], bounds[1], "normal", shared, seed)
    if not is_finite or np.any(bounds[0] > bounds[1]):
        raise ValueError(f"{name}({low!r}, {high!r}): the bounds must be finite numbers, the lower one first")
    if name == "log_uniform" and not np.all(bounds[0] > 0.0):
        raise ValueError(f"log_uniform({low!r}, {high!r}): the bounds must be above 0")
    return Draw(kind, bounds[0], bounds[1], "log_uniform" if name == "log_uniform" else "uniform", shared, seed)


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
