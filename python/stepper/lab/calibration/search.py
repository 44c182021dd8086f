"""Search for the smallest set of parameters that must be measured, and for the widest tolerances.

A world is a vector of true parameter values. Its model has the measured values of the parameters in the set, and the nominal values of all
others. A set passes if the outcome of the model differs from that of the world by more than the margin in at most `ALLOWED` of the worlds.

1. A parameter is necessary if the set of all others, measured exactly, fails.
2. The smallest set is the first that passes among the necessary parameters with k of the others, k = 0, 1, ..., in the order of their
   total Sobol indices. This is the minimum if a measurement of one more parameter never makes a model worse.
3. Tolerances are halved together until the set passes, and then doubled one at a time, the least influential parameter first.

A certificate is on worlds that were drawn after the set was chosen. Clopper and Pearson's bound gives the largest plausible fraction of
worlds above the margin: 59 worlds without a violation certify 95 % of worlds with 95 % confidence. If a certificate fails, the set is
changed and tried on new worlds. The probability of an error is divided by the number of planned tries, as in Bonferroni's correction.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.intervals import greatest_share, least_share, trials_for

Array = NDArray[np.float64]
Difference = Callable[[Array, Array], Array]
"""Function of true and of modelled parameter values, (n, parameters) each, that returns the difference of the outcomes, (n,)."""

SHARE = 0.95
"""Fraction of plausible worlds for which a certificate holds."""
ALLOWED = 0.01
"""Fraction of the worlds of the search in which a set that passes may exceed the margin. It is well below 1 - `SHARE`, because the upper
bound of a certificate, not its estimate, must be below that."""
_FIRST_BLOCK = 24
"""Number of worlds that are run first, because most sets that fail do so in many worlds. Those that failed most often before come first."""
_MAX_SETS = 256
"""Number of sets of one search after which sets are reduced one parameter at a time instead."""
_FINEST = 2.0**-10
"""Finest tolerance of the search, as a fraction of a parameter's range."""
UNMEASURED = np.inf
"""Tolerance that stands for a parameter that is not measured."""


@dataclass(frozen=True)
class Space:
    """Plausible worlds: independent uniform parameters.

    Attributes:
        low, high: Ends of the ranges, (parameters,).
        nominal: Values of parameters that are not measured, (parameters,).
    """

    low: Array
    high: Array
    nominal: Array

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Draws worlds, (count, parameters), and the signs of their measurement errors, -1 or 1, of the same shape."""
        shape = (count, len(self.low))
        return rng.uniform(self.low, self.high, shape), rng.choice([-1.0, 1.0], shape)

    def model(self, worlds: Array, signs: Array, tolerances: Array) -> Array:
        """Parameters of the models of worlds, (n, parameters), in their units, like the true values `worlds`.

        Each error has the size of the tolerance, a fraction of the range, (parameters,), and the sign in `signs`, (n, parameters). The sign
        changes if the measured value would be outside the range. `UNMEASURED` stands for nominal values.
        """
        unmeasured = np.isinf(tolerances)
        error = signs * np.where(unmeasured, 0.0, tolerances) * (self.high - self.low)
        outside = (worlds + error < self.low) | (worlds + error > self.high)
        measured = np.clip(worlds + np.where(outside, -error, error), self.low, self.high)
        return np.where(unmeasured, self.nominal, measured)


@dataclass(frozen=True)
class Trial:
    """Result of tolerances on worlds.

    Attributes:
        violations: Number of worlds whose difference exceeds the margin.
        worlds: Number of worlds.
        differences: Difference of the outcome in each world, (worlds,).
    """

    violations: int
    worlds: int
    differences: Array = field(repr=False)

    @property
    def fails_surely(self) -> bool:
        """Whether more than 1 - `SHARE` of all worlds exceed the margin, with 95 % confidence."""
        return least_share(self.violations, self.worlds) > 1.0 - SHARE

    def quantile(self, confidence: float) -> float:
        """Difference that at least `SHARE` of all worlds do not exceed, with this confidence; infinite with too few worlds."""
        ordered = np.sort(self.differences)
        for rank in range(len(ordered)):
            if greatest_share(len(ordered) - rank - 1, len(ordered), confidence) <= 1.0 - SHARE:
                return float(ordered[rank])
        return float("inf")


class Search:
    """Search on a growing sample of worlds.

    Args:
        difference: Difference of the outcomes of worlds and models. NaN counts as a difference above every margin.
        space: Plausible worlds.
        margin: Largest difference that is allowed, in the unit of the outcome.
        importance: Total Sobol index of each parameter, (parameters,).
        count: Number of worlds.
        rng: Random number generator of the worlds.
    """

    def __init__(self, difference: Difference, space: Space, margin: float, importance: Array, *, count: int, rng: np.random.Generator):
        self._difference, self.space, self.margin, self._importance = difference, space, margin, importance
        self.worlds, self.signs = space.draw(rng, count)
        self._failed = np.zeros(count, int)

    def add(self, worlds: Array, signs: Array) -> None:
        """Adds worlds in which a certificate failed: true values in their units, and signs of errors, (n, parameters) each."""
        self.worlds, self.signs = np.concatenate([worlds, self.worlds]), np.concatenate([signs, self.signs])
        self._failed = np.concatenate([np.zeros(len(worlds), int), self._failed])

    def trial(self, tolerances: Array, worlds: Array, signs: Array) -> Trial:
        """Result of tolerances, (parameters,) as fractions of the ranges, on given worlds, all of which are run (see `Space.model`)."""
        found = np.asarray(self._difference(worlds, self.space.model(worlds, signs, tolerances)), float)
        found = np.where(np.isnan(found), np.inf, found)
        return Trial(int(self.exceeds(found).sum()), len(found), found)

    def exceeds(self, differences: Array) -> NDArray[np.bool_]:
        """Whether differences, (k,), exceed the margin, (k,). Differences of means of the same numbers may be rounded differently."""
        return np.asarray(differences > self.margin * (1.0 + 1e-9))

    def passes(self, tolerances: Array) -> bool:
        """Whether tolerances, (parameters,) as fractions of the ranges, pass on the worlds of the search."""
        left, order = int(ALLOWED * len(self.worlds)), np.argsort(-self._failed, kind="stable")
        for part in (order[:_FIRST_BLOCK], order[_FIRST_BLOCK:]):
            if len(part):
                trial = self.trial(tolerances, self.worlds[part], self.signs[part])
                self._failed[part] += self.exceeds(trial.differences)
                left -= trial.violations
            if left < 0:
                return False
        return True

    def smallest(self) -> list[int]:
        """Smallest set that passes with exact measurements, as indices of parameters in descending order of importance."""
        return smallest_set(lambda chosen: self.passes(self._exact(chosen)), self._importance)

    def widest(self, chosen: Sequence[int]) -> Array:
        """Widest tolerances of a set that passes, (parameters,), as fractions of the ranges: powers of 2 up to 1/2."""
        tolerances = self._exact(set(chosen))
        if not chosen:
            return tolerances
        measured, size = np.isfinite(tolerances), 0.5
        while not self.passes(np.where(measured, size, tolerances)):
            size /= 2.0
            if size < _FINEST:
                raise ValueError(
                    f"the outcome exceeds the margin, {self.margin:g}, even if parameters are measured to 1/1024 of their ranges, because "
                    "it jumps or is chaotic: choose a larger margin, more episodes, or an outcome that averages over more motion"
                )
        tolerances[measured] = size
        for k in reversed(chosen):
            while tolerances[k] < 0.5:
                wider = tolerances.copy()
                wider[k] *= 2.0
                if not self.passes(wider):
                    break
                tolerances = wider
        return tolerances

    def weaker(self, tolerances: Array, k: int, worlds: Array, signs: Array) -> dict[str, Trial]:
        """Results of weaker alternatives on given worlds, by name: one parameter left out, or its tolerance multiplied by 2, 4, ...

        The last alternative is the first that surely fails, or has a tolerance above half the range. `tolerances`, (parameters,) as
        fractions of the ranges, pass, and k is the index of the parameter. Worlds are those of `Space.model`.
        """
        other = tolerances.copy()
        other[k] = UNMEASURED
        found, factor = {"left out": self.trial(other, worlds, signs)}, 2
        while factor == 2 or (factor * tolerances[k] <= 0.5 and not list(found.values())[-1].fails_surely):
            other[k] = factor * tolerances[k]
            found[f"x{factor}"] = self.trial(other, worlds, signs)
            factor *= 2
        return found

    def _exact(self, chosen: set[int]) -> Array:
        """Tolerances of a set that is measured exactly."""
        return np.array([0.0 if k in chosen else UNMEASURED for k in range(len(self._importance))])


def smallest_set(passes: Callable[[set[int]], bool], importance: Array) -> list[int]:
    """Smallest set of parameters for which `passes` is true, as indices in descending order of importance, (parameters,).

    Sets of equal size are tried in that order. The set of all parameters must pass.
    """
    n, order = len(importance), [int(k) for k in np.argsort(-importance, kind="stable")]
    needed = {k for k in range(n) if not passes(set(range(n)) - {k})}
    others = [k for k in order if k not in needed]
    # The smallest subsets are first, and among those of equal size the ones with the most important members.
    subsets = itertools.chain.from_iterable(itertools.combinations(others, size) for size in range(len(others) + 1))
    for number, more in enumerate(subsets):
        if len(more) == len(others) or passes(needed | set(more)):
            return [k for k in order if k in needed | set(more)]
        if number == _MAX_SETS:
            break
    chosen = set(order)
    for k in reversed(others):
        if passes(chosen - {k}):
            chosen -= {k}
    return [k for k in order if k in chosen]


CONFIDENCE = 0.95
"""Confidence of all tries together."""


@dataclass(frozen=True)
class Certificate:
    """Certificate: in at least 95 % of plausible worlds the outcome differs by at most the margin.

    Attributes:
        trial: Result on the worlds of the certificate.
        confidence: Confidence of this try.
        number: Number of this try, from 1.
        tries: Number of planned tries.
    """

    trial: Trial
    confidence: float
    number: int
    tries: int

    @property
    def bound(self) -> float:
        """Largest plausible fraction of worlds above the margin."""
        return greatest_share(self.trial.violations, self.trial.worlds, self.confidence)

    @property
    def holds(self) -> bool:
        """Whether the certificate holds."""
        return self.bound <= 1.0 - SHARE + 1e-12


def confidence_of(tries: int) -> float:
    """Confidence of each try, so that all tries together have the confidence `CONFIDENCE`."""
    return 1.0 - (1.0 - CONFIDENCE) / tries


def worlds_for(violations: int, tries: int) -> int:
    """Smallest number of worlds for a certificate with this number of violations."""
    first = trials_for(SHARE, confidence_of(tries))
    return next(n for n in count(first) if greatest_share(violations, n, confidence_of(tries)) <= 1.0 - SHARE)
