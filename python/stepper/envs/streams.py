"""Random numbers of resets: a stream for each environment, drawn for many environments at once."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Words = NDArray[np.uint64]

_GAMMA, _MIX_1, _MIX_2 = (np.uint64(k) for k in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
_SHIFTS = tuple(np.uint64(k) for k in (30, 27, 31))
_MANTISSA = np.uint64(11)
_STEP = 2.0**-53
"""Distance of two neighbouring uniform numbers."""


def _mix(words: Words) -> Words:
    """Steele, Lea and Flood's finalizer (splitmix64), in place: a permutation of 64-bit words that hides what they have in common."""
    words ^= words >> _SHIFTS[0]
    words *= _MIX_1
    words ^= words >> _SHIFTS[1]
    words *= _MIX_2
    words ^= words >> _SHIFTS[2]
    return words


@lru_cache(maxsize=64)
def _steps(size: int) -> Words:
    """Increments of a state for each of the next words: (size,)."""
    return np.multiply(np.arange(1, size + 1, dtype=np.uint64), _GAMMA, dtype=np.uint64)


@lru_cache(maxsize=256)
def _word_of(name: str) -> np.uint64:
    """Word of a name: a hash that is the same in every process."""
    return np.uint64(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little"))


class Streams:
    """Streams of random numbers, one per environment: splitmix64 with counters, so that many streams are one array operation.

    The numbers of an environment depend only on its seed and on the count of numbers that it drew before.

    Args:
        num_envs: Number of streams.
        seed: Seed of the first stream; stream i has seed + i.

    Attributes:
        state: State of each stream, (num_envs,) uint64, which determines its next numbers.
        ages: Steps and resets of each environment since it was seeded, (num_envs,).
    """

    def __init__(self, num_envs: int, seed: int):
        self.state: Words = np.zeros(num_envs, dtype=np.uint64)
        self.ages: Words = np.zeros(num_envs, dtype=np.uint64)
        self.seed(np.arange(num_envs), [(seed + k) % 2**64 for k in range(num_envs)])

    def seed(self, envs: Array, seeds: Sequence[int]) -> None:
        """Restarts streams.

        Args:
            envs: Indices of the streams, (n,).
            seeds: A seed for each of them, 0 to 2^64 - 1.

        Raises:
            ValueError: A seed out of range.
        """
        for env, seed in zip(envs, seeds, strict=True):
            if not 0 <= seed < 2**64:
                raise ValueError(f"the seed of environment {env} is {seed}, must be from 0 to 2**64 - 1")
        words: Words = np.array(seeds, dtype=np.uint64)
        self.state[envs] = _mix(_mix(words) + _GAMMA)
        self.ages[envs] = 0

    def fork(self, name: str) -> Streams:
        """Independent streams that depend on these streams, their ages and a name. Drawing from them does not change these."""
        made = copy.copy(self)
        made.state = _mix(_mix(self.state + _word_of(name)) + self.ages * _GAMMA)
        return made

    def words(self, envs: Array, size: int) -> Words:
        """The next `size` words of the streams `envs` (n,): (n, size) uint64."""
        words = self.state[envs][:, None] + _steps(size)
        if size:
            self.state[envs] = words[:, -1]
        return _mix(words)


class Rng:
    """Random numbers for the n environments that are reset: a row for each of them, from the stream of that environment.

    Draws have the shape (n, size): `size` numbers for each environment. `array[mask] = rng.uniform(low, high, size)` fits an array
    (num_envs, size) of all environments.

    Args:
        streams: Streams of all environments.
        envs: Indices of those that are reset, (n,).
    """

    def __init__(self, streams: Streams, envs: Array):
        self._streams, self.envs = streams, envs

    def uniform(self, low: float, high: float, size: int) -> Array:
        """Uniform random numbers from `low` to `high`, (n, size): `size` for each environment."""
        words = self._streams.words(self.envs, size)
        words >>= _MANTISSA
        numbers = words.astype(np.float64)
        numbers *= (high - low) * _STEP
        numbers += low
        return numbers

    def normal(self, size: int) -> Array:
        """Standard normal random numbers, (n, size): `size` for each environment, by the Box-Muller method."""
        pairs = (size + 1) // 2
        words = (self._streams.words(self.envs, 2 * pairs) >> _MANTISSA).astype(np.float64) * _STEP
        radius, angle = np.sqrt(-2.0 * np.log1p(-words[:, :pairs])), 2.0 * np.pi * words[:, pairs:]
        return np.hstack([radius * np.cos(angle), radius * np.sin(angle)])[:, :size]

    def of(self, rows: Array) -> Rng:
        """Random numbers of a subset of the environments, by a boolean mask (n,), for rejection sampling."""
        return Rng(self._streams, self.envs[rows])
