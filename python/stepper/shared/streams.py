"""Random numbers of environments: one stream per environment, and vectorised draws from many streams."""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import NDArray

from stepper.shared.arguments import check_whole

P = ParamSpec("P")
Array = NDArray[Any]
Words = NDArray[np.uint64]

_GAMMA, _MIX_1, _MIX_2 = (np.uint64(k) for k in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
_SHIFTS = tuple(np.uint64(k) for k in (30, 27, 31))
"""Constants of splitmix64: increment of the counter, and the two factors and three shifts of the hash."""
_MANTISSA = np.uint64(11)
"""Shift from a 64-bit integer to the 53 bits of a float's mantissa."""
_STEP = 2.0**-53
"""Distance between neighbouring uniform random numbers in [0, 1)."""


def _mix(words: Words) -> Words:
    """Hashes 64-bit integers in place with Steele, Lea and Flood's finalizer (splitmix64), a permutation, and returns the hashes."""
    words ^= words >> _SHIFTS[0]
    words *= _MIX_1
    words ^= words >> _SHIFTS[1]
    words *= _MIX_2
    words ^= words >> _SHIFTS[2]
    return words


def seeds(run: int | Sequence[int], num_envs: int) -> list[int]:
    """Returns independent seeds of the environments of a run, num_envs whole numbers below 2^64, for `reset(seed=...)`.

        envs.reset(seed=stepper.envs.seeds(1, envs.num_envs))

    Other runs have other seeds. `reset(seed=1)` instead gives environment i the seed 1 + i, as in Gymnasium: then all environments of run 1
    except the first have seeds of run 2. For the same run and a larger `num_envs`, the list begins with the same seeds.

    Args:
        run: Seed of the run, a whole number of at least 0; or several, such as (seed, worker).
        num_envs: Number of environments.

    Raises:
        TypeError, ValueError: A number is not whole, or negative.
    """
    for number in run if isinstance(run, Sequence) else [run]:
        check_whole("the seed of a run", number, least=0)
    check_whole("num_envs", num_envs, least=0)
    words: list[int] = np.random.SeedSequence(run).generate_state(num_envs, np.uint64).tolist()
    return words


@lru_cache(maxsize=64)
def _steps(size: int) -> Words:
    """Increments of a stream's counter for its next `size` random numbers, (size,) uint64."""
    return np.multiply(np.arange(1, size + 1, dtype=np.uint64), _GAMMA, dtype=np.uint64)


@lru_cache(maxsize=256)
def _hash_of(name: str) -> np.uint64:
    """64-bit hash of a name, which is the same in every process."""
    return np.uint64(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little"))


class Streams:
    """Streams of random numbers, one per environment.

    The generator is splitmix64, a hash of a counter, so that one array operation draws from many streams.

    The numbers of an environment depend only on its seed and on how many numbers were drawn from its stream before.

    Args:
        num_envs: Number of streams.
        seed: Seed of the first stream; stream i has seed + i.

    Attributes:
        state: State of each stream, (num_envs,) uint64, which determines its next numbers.
        ages: Age of each environment, (num_envs,): number of steps and resets since it was seeded; in studies, number of control periods.
    """

    def __init__(self, num_envs: int, seed: int):
        self.state: Words = np.zeros(num_envs, dtype=np.uint64)
        self.ages: Words = np.zeros(num_envs, dtype=np.uint64)
        self.seed(np.arange(num_envs), [(seed + k) % 2**64 for k in range(num_envs)])

    def seed(self, envs: Array, seeds: Sequence[int]) -> None:
        """Restarts random number streams from seeds, and sets their ages to 0.

        Args:
            envs: Indices of the environments whose streams restart, (n,).
            seeds: Seed of each stream, n numbers from 0 to 2^64 - 1.
        """
        for env, seed in zip(envs, seeds, strict=True):
            if not 0 <= seed < 2**64:
                raise ValueError(f"the seed of environment {env} is {seed}, must be from 0 to 2**64 - 1")
        words: Words = np.array(seeds, dtype=np.uint64)
        self.state[envs] = _mix(_mix(words) + _GAMMA)
        self.ages[envs] = 0

    def fork(self, name: str) -> Streams:
        """Independent streams of random numbers that depend on these streams, on `ages` and on a name. These streams do not change."""
        forked = object.__new__(Streams)
        forked.ages = self.ages
        forked.state = _mix(_mix(self.state + _hash_of(name)) + self.ages * _GAMMA)
        return forked

    def words(self, envs: Array, size: int) -> Words:
        """Next `size` random 64-bit integers from the streams of the environments `envs`, indices (n,): (n, size) uint64."""
        words = self.state[envs][:, None] + _steps(size)
        if size:
            self.state[envs] = words[:, -1]
        return _mix(words)


def _shape_of(size: int | tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the numbers of one environment, from the argument `size` of a draw."""
    if type(size) is int and size >= 0:  # A fast test of the usual size.
        return (size,)
    shape = size if isinstance(size, tuple) else (size,)
    try:
        if min(map(operator.index, shape), default=0) >= 0:
            return shape
    except TypeError:
        raise TypeError(
            f"size is {size!r}, must be a whole number or a tuple of them: how many numbers each environment gets, as rng.uniform(-1, 1, 3)"
        ) from None
    raise ValueError(f"size is {size!r}, must be at least 0")


class Rng:
    """Random number generator for n environments. Each environment draws from a stream that depends only on its seed.

    Draws have the shape (n, size): `size` numbers for each environment. In `Task.reset`,
    `reset.episode_state[name] = reset.rng.uniform(low, high, size)` sets the rows of the new episodes. `size` may be a tuple: (3, 2) gives
    (n, 3, 2). The only draws are `uniform` and `normal`. Unlike NumPy's generators, this generator gives each environment the same
    numbers in batches of every size.

    Args:
        streams: Streams of all environments.
        envs: Indices of the n environments, (n,).
    """

    def __init__(self, streams: Streams, envs: Array):
        self._streams, self.envs = streams, envs

    def uniform(self, low: float, high: float, size: int | tuple[int, ...]) -> Array:
        """Returns uniform random numbers from `low` to `high`, (n, size): `size` for each environment."""
        shape = _shape_of(size)
        words = self._streams.words(self.envs, math.prod(shape))
        words >>= _MANTISSA
        numbers = words.astype(np.float64).reshape(len(self.envs), *shape)
        numbers *= (high - low) * _STEP
        numbers += low
        return numbers

    def normal(self, size: int | tuple[int, ...]) -> Array:
        """Returns standard normal random numbers, (n, size): `size` for each environment, by the Box-Muller method."""
        shape = _shape_of(size)
        count = math.prod(shape)
        pairs = (count + 1) // 2
        words = (self._streams.words(self.envs, 2 * pairs) >> _MANTISSA).astype(np.float64) * _STEP
        radius, angle = np.sqrt(-2.0 * np.log1p(-words[:, :pairs])), 2.0 * np.pi * words[:, pairs:]
        return np.hstack([radius * np.cos(angle), radius * np.sin(angle)])[:, :count].reshape(len(self.envs), *shape)

    def of(self, rows: Array) -> Rng:
        """Returns a generator for a subset of the n environments, given by the boolean mask `rows` (n,), for rejection sampling."""
        return Rng(self._streams, self.envs[rows])
