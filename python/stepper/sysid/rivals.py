"""Other frictions beside an estimate: the values that are tried, which of them hold, which are excluded, and which is a rival.

Friction that holds has no slope: less of it would slip, more changes nothing. So every window is also predicted with other frictions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepper.sysid.inertia import Array

WIDE = 0.3
"""Parameters of which less is known than this, in scales, count as unknown: what lies farther away is another motion."""
FLAT = 0.01
"""Sum of squares of residuals below which two frictions predict the same."""
KINKED = (*(f"{field}_friction[{column}]" for field in ("geom", "pair") for column in range(3)), "dof_frictionloss")
"""Kinds that have no slope where nothing slides."""
OTHERS = (-0.5, -0.15, 0.15, 0.5)
"""Logarithms of the ratios by which other values of these are tried at every sample, beside some standard deviations more and less,"""
NEAR = 2.5
"""which are so many, of at least"""
NEAREST = 0.005
"""as a logarithm,"""
TRIED = len(OTHERS) + 3
ABOVE_BOUND = 0.02
"""And the one that is this far above the lower bound, so that the bound rises by it with every sample."""
BETTER = 1.0
"""A larger value is a rival if it lowers the cost by this. One that costs at most this much more says that friction holds."""
LOWER = 0.0
"""A smaller value is a rival of one that is unknown if it lowers the cost by this. Its weight is a tenth then, as frictions that slip so
little are a thirtieth of what is not known."""
EXCLUDED = 12.0
"""A smaller value is a rival of one that is known, and a value is excluded, where the costs differ by this: 3.5 standard deviations."""

NOTHING = 0.01
"""Share of what was known before that slopes add, below which they are not compared with costs farther away."""
TELLING = 2.0
"""Squares of distances over the variance by the slopes from which on costs are compared with it,"""
POSSIBLE = 9.0
"""if they are not higher by more than this: three standard deviations."""
LEAST = 0.04
"""Smallest share: intervals grow five times at the most."""


@dataclass(frozen=True)
class Verdict:
    """What other frictions say of an estimate.

    Attributes:
        rival: Index of a point whose friction explains the window better, or None.
        holding: Indices of frictions that hold: the window has no slope in them.
        excluded: Largest value that is excluded, by the index of the friction.
        rises: Of frictions that do not hold, distances of the other values, and by how much they raise the cost, (k, 2).
    """

    rival: int | None
    holding: list[int]
    excluded: dict[int, float]
    rises: dict[int, Array]


def tried(x: float, std: float, bound: float) -> Array:
    """Values beside x that are tried, (TRIED,)."""
    last = bound + ABOVE_BOUND if math.isfinite(bound) else x + 2 * OTHERS[0]
    near = float(np.clip(NEAR * std, NEAREST, -OTHERS[1] / 2))
    return np.array([*(x + step for step in (*OTHERS, -near, near)), last])


def judged(
    kinked: list[int], unknown: list[bool], *, points: Array, residual: Array, J: Array, mean: Array, cov: Array, first: int
) -> Verdict:
    """Verdict on an estimate.

    Args:
        kinked: Indices of frictions.
        unknown: Whether the readings before the window leave each of them unknown.
        points: The estimate and all other points, (count, N).
        residual: Their residuals, (count, T, width).
        J: Derivatives at the estimate, (T, width, N).
        mean: Mean of the arrival cost, (N,).
        cov: Its covariance, (N, N).
        first: Index of the first point with another friction.
    """
    rival, gain, holding = None, 0.0, []
    excluded: dict[int, float] = {}
    rises: dict[int, Array] = {}
    for k, j in enumerate(kinked):
        index = np.array([0, *range(first + k * TRIED, first + (k + 1) * TRIED)])
        values = points[index, j]
        window, known = _profiles(j, points[index], residual[index], J=J, mean=mean, cov=cov)
        gone = values[(values < values[window.argmin()]) & (window > window.min() + EXCLUDED)]
        if len(gone):
            excluded[j] = float(gone.max())
        if _holds(residual[index], values, window, unknown=unknown[k]):
            holding.append(j)
        else:
            rises[j] = np.stack([values - values[0], known - known[0]], axis=1)
        needed = np.where(values < values[0], LOWER if unknown[k] else EXCLUDED, BETTER)
        excess = known[0] - known - needed
        if excess.max() > gain:
            rival, gain = int(index[excess.argmax()]), float(excess.max())
    return Verdict(rival, holding, excluded, rises)


def share_of(rises: Array, step: float, *, before: float, after: float) -> float:
    """Share of what the slopes at the estimate say of a friction that the costs farther away confirm, 1 where they do.

    Where friction begins to slip, the cost rises less towards what holds than the slope at the estimate says.

    Args:
        rises: Distances of other values from the estimate, and by how much they raise the cost, (k, 2).
        step: Distance of the least cost from the estimate, by the slopes.
        before: Variance of the friction before the window.
        after: Variance by the slopes.
    """
    gained = 1 / after - 1 / before
    if gained * before < NOTHING:
        return 1.0
    shares = [
        ((rise + 2 * apart * step / after) / apart**2 - 1 / before) / gained
        for apart, rise in rises
        if apart**2 >= TELLING * after and rise <= POSSIBLE
    ]
    return float(np.clip(min(shares, default=1.0), LEAST, 1.0))


def widened(covariance: Array, j: int, before: float, share: float) -> Array:
    """Covariance in which a friction is known by a share of the information that a variance before has gained; others follow it."""
    after = float(covariance[j, j])
    gained = 1 / after - 1 / before
    if share >= 1 or gained <= 0:
        return covariance
    variance = 1 / (1 / before + share * gained)
    along = covariance[:, j] / after
    return np.asarray(covariance + (variance - after) * np.outer(along, along))


def _profiles(j: int, points: Array, residual: Array, *, J: Array, mean: Array, cov: Array) -> tuple[Array, Array]:
    """Costs of points with values of the friction j, once all other numbers have made the best of them.

    Returns:
        Costs by the window, with what is known of the other numbers; costs with what is known of friction too.
    """
    N = points.shape[1]
    whole = np.linalg.inv(np.linalg.cholesky(cov))
    left = residual.reshape(len(points), -1)
    others = np.delete(np.arange(N), j)
    slope = J.reshape(-1, N)[:, others]
    root = np.linalg.inv(np.linalg.cholesky(cov[np.ix_(others, others)]))
    apart = points - mean
    window = _least(np.concatenate([slope, root]), np.concatenate([left, apart[:, others] @ root.T], axis=1))
    known = _least(np.concatenate([slope, whole[:, others]]), np.concatenate([left, apart @ whole.T], axis=1))
    return window, known


def _holds(residual: Array, values: Array, window: Array, *, unknown: bool) -> bool:
    """Whether friction holds at the estimate, the first of the points.

    What slides in the two largest values says that friction and mass are known together only. A friction that is known may slip a little
    where the readings do not: then the slope says that friction is what just holds, but all larger values explain the window as well.
    """
    *_, second, largest = np.argsort(values)
    if unknown:
        return _same(residual[0], residual[largest])
    return bool(window[largest] <= window.min() + BETTER) and _same(residual[second], residual[largest])


def _same(one: Array, other: Array) -> bool:
    return float(((one - other) ** 2).sum()) < FLAT


def _least(A: Array, b: Array) -> Array:
    """Least sums of squares of rows b (count, m) minus what the columns of A (m, k) span, (count,)."""
    Q = np.linalg.qr(A / np.linalg.norm(A, axis=0))[0]
    return np.asarray((b**2).sum(axis=1) - ((b @ Q) ** 2).sum(axis=1))
