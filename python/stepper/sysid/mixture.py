"""Mixture of a tracker's hypotheses about friction (sticking or slipping), each with an estimate and a weight.

Near the onset of slip, readings often do not show whether an object has slipped, and the two cases give different masses. An immediate
decision would make all later intervals too narrow. A rival (another friction that explains the readings, rivals.py) therefore
starts another hypothesis (a Gaussian sum, Alspach and Sorenson 1972), weighted by Laplace's approximation of its evidence. If an object
slips in all hypotheses, a hypothesis is added in which friction holds the object, and the object's mass is estimated again. Hypotheses
with little weight are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepper.sysid.horizon import Horizon
from stepper.sysid.inertia import Array
from stepper.sysid.problem import Problem, Sample
from stepper.sysid.uncertainty import RIDGE, root_of

MAX_HYPOTHESES = 4
"""Largest number of a tracker's hypotheses about friction."""
UNLIKELY = 0.01
"""Probability below which a hypothesis is dropped. It is less than the 2.5 % beyond each end of a 95 % interval."""
CLOSE = 0.05
"""Difference of log(friction) between a point and a hypothesis below which the point starts no new hypothesis."""
CLOSE_STD = 3.0
"""Difference of log(friction) between a point and a hypothesis below which the point starts no new hypothesis.

It is in standard deviations of the hypothesis. The larger of this limit and `CLOSE` applies.
"""
MERGE_DISTANCE = 0.3
"""Largest difference of the estimates of two hypotheses that are merged, in units of the smaller of their standard deviations."""
MERGE_STD_RATIO = 1.5
"""Largest ratio of the standard deviations of two hypotheses that are merged."""


@dataclass(frozen=True)
class Mixture:
    """Weighted sum of normal distributions of the n parameters (the vector theta), one under each of k hypotheses.

    Attributes:
        weights: Probability of each hypothesis, (k,).
        means: Mean of the parameters under each hypothesis, (k, n).
        covariances: Covariance of the parameters under each hypothesis, (k, n, n).
        lows: Lower bounds of the parameters under each hypothesis, (k, n).
        high: Upper bounds of the parameters under all hypotheses, (n,).
    """

    weights: Array
    means: Array
    covariances: Array
    lows: Array
    high: Array

    def mean(self) -> Array:
        """Mean of the parameter vector theta, (n,)."""
        return np.asarray(self.weights @ self.means)

    def covariance(self) -> Array:
        """Covariance of the parameter vector theta, (n, n)."""
        apart = self.means - self.mean()
        return np.asarray(np.einsum("k,kij->ij", self.weights, self.covariances + apart[:, :, None] * apart[:, None, :]))

    def quantile(self, sigmas: float) -> Array:
        """Quantiles of the parameter vector theta, clipped to the bounds, (n,).

        Args:
            sigmas: Probability of the quantile, as the number of standard deviations of a normal distribution: 1.96 is 97.5 %.
        """
        stds = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))
        ends = np.clip(self.means + sigmas * stds, self.lows, self.high)
        if len(ends) == 1:
            return np.asarray(ends[0])
        return np.array([self._quantile(j, sigmas, ends[:, j], stds[:, j]) for j in range(len(self.high))])

    def _quantile(self, j: int, sigmas: float, ends: Array, std: Array) -> float:
        """Quantile of one parameter of the mixture, by bisection between the quantiles of its normal distributions.

        Args:
            j: Index of the parameter.
            sigmas: Probability of the quantile, as the number of standard deviations of a normal distribution: 1.96 is 97.5 %.
            ends: Quantiles of the parameter under each hypothesis, (k,).
            std: Standard deviations of the parameter under each hypothesis, (k,).
        """
        low, high, share = float(ends.min()), float(ends.max()), _normal(sigmas)
        for _ in range(50):
            middle = (low + high) / 2
            below = [
                1.0 if middle >= self.high[j] else 0.0 if middle < bound else _normal((middle - mean) / s)
                for mean, s, bound in zip(self.means[:, j], std, self.lows[:, j], strict=True)
            ]
            low, high = (low, middle) if float(self.weights @ below) >= share else (middle, high)
        return (low + high) / 2

    def draw(self, count: int, seed: int) -> Array:
        """Random parameter vectors theta from the mixture, clipped to the bounds, (count, n)."""
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal((count, len(self.high)))
        chosen = rng.choice(len(self.weights), count, p=self.weights)
        roots = root_of(self.covariances, RIDGE)
        drawn = self.means[chosen] + np.einsum("cij,cj->ci", roots[chosen], normal)
        return np.asarray(np.clip(drawn, self.lows[chosen], self.high))


def mixture_of(hypotheses: Sequence[Horizon], problem: Problem) -> Mixture:
    """Distribution of the parameters: the weighted sum of their normal distributions under some hypotheses."""
    n = problem.n
    return Mixture(
        weights_of(hypotheses),
        np.stack([h.x[:n] for h in hypotheses]),
        np.stack([h.posterior[:n, :n] for h in hypotheses]),
        np.stack([h.low() for h in hypotheses]),
        problem.high,
    )


def weights_of(hypotheses: Sequence[Horizon]) -> Array:
    """Probabilities of hypotheses, (k,), from the evidence of each; their sum is 1."""
    evidence = np.array([h.evidence for h in hypotheses])
    share = np.exp(evidence - evidence.max())
    return np.asarray(share / share.sum())


def updated(hypotheses: Sequence[Horizon], sample: Sample, problem: Problem) -> list[Horizon]:
    """Hypotheses after a new sample, the most probable first.

    A point with another friction that explains the readings starts a new hypothesis, if predictions are left for it. Improbable hypotheses
    are dropped.

    Args:
        hypotheses: Hypotheses before the sample.
        sample: Controls and readings.
        problem: Fixed data of the tracker.
    """
    for hypothesis in hypotheses:
        hypothesis.take(sample)
    out = list(hypotheses)
    for hypothesis in hypotheses:
        if problem.budget.left <= 0:
            break
        if hypothesis.rival is None or any(_near(other, hypothesis.rival, problem) for other in out if other is not hypothesis):
            continue
        try:
            child = hypothesis.branch(hypothesis.rival)
        except (FloatingPointError, np.linalg.LinAlgError):
            # Parameters whose prediction is not finite have the probability 0.
            continue
        if not any(_alike(child, other, problem) for other in out):
            out.append(child)
    return _likely(out + _held(out, problem), problem)


def _held(hypotheses: Sequence[Horizon], problem: Problem) -> list[Horizon]:
    """New hypotheses in which an object sticks, for frictions at which the object slips in all given hypotheses."""
    out: list[Horizon] = []
    for hypothesis in hypotheses:
        for j in hypothesis.worth_trying_held():
            if problem.budget.left <= 0 or any(other.holds(j) for other in (*hypotheses, *out)):
                continue
            try:
                held = hypothesis.held(j)
            except (FloatingPointError, np.linalg.LinAlgError):
                continue
            if held is not None:
                out.append(held)
    return out


def _likely(hypotheses: list[Horizon], problem: Problem) -> list[Horizon]:
    """Most probable of some hypotheses, at most `MAX_HYPOTHESES`, in descending order; similar hypotheses are merged."""
    kept: list[Horizon] = []
    for hypothesis in sorted(hypotheses, key=lambda h: -h.evidence):
        for other in kept:
            if _alike(hypothesis, other, problem):
                other.absorb(hypothesis.evidence)
                break
        else:
            kept.append(hypothesis)
    weights = weights_of(kept)
    return [h for h, weight in zip(kept, weights, strict=True) if weight >= UNLIKELY][:MAX_HYPOTHESES]


def _near(hypothesis: Horizon, x: Array, problem: Problem) -> bool:
    """Whether the frictions of a point x, (n + states,), are so close to those of a hypothesis that x needs no new hypothesis."""
    std = np.sqrt(np.diag(hypothesis.posterior))
    return all(abs(hypothesis.x[j] - x[j]) <= max(CLOSE, CLOSE_STD * std[j]) for j in problem.kinked)


def _alike(one: Horizon, other: Horizon, problem: Problem) -> bool:
    """Whether two hypotheses have nearly the same distribution of the parameters, so that they can be merged."""
    n = problem.n
    stds = np.sqrt([np.diag(one.posterior)[:n], np.diag(other.posterior)[:n]])
    least, most = stds.min(axis=0), stds.max(axis=0)
    return bool((np.abs(one.x[:n] - other.x[:n]) <= MERGE_DISTANCE * least).all() and (most <= MERGE_STD_RATIO * least).all())


def _normal(z: float) -> float:
    """Cumulative distribution function of the standard normal distribution at z."""
    return math.erfc(-z / math.sqrt(2)) / 2
