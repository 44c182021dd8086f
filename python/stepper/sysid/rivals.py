"""Frictions other than the estimate: which of them hold, which are excluded, which is a rival, and how far slopes can be trusted.

Friction that holds has no slope: less of it would slip, more changes nothing. So each window is also predicted with other frictions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepper.sysid.inertia import Array

WIDE = 0.3
"""Standard deviation, in scales, above which a parameter counts as unknown."""
FLAT = 0.01
"""Sum of squared differences of residuals below which two frictions predict the same."""
KINKED = (*(f"{field}_friction[{column}]" for field in ("geom", "pair") for column in range(3)), "dof_frictionloss")
"""Kinds of parameters that have no slope where nothing slides."""
OTHERS = (-0.5, -0.15, 0.15, 0.5)
"""Logarithms of the ratios of other frictions to the estimate."""
NEAR = 2.5
"""Distance of the two nearest other frictions, in standard deviations."""
NEAREST = 0.005
"""Smallest such distance, as a logarithm."""
ABOVE_BOUND = 0.02
"""Distance of another friction from the lower bound, as a logarithm: the bound can rise by it with every sample."""
TRIED = len(OTHERS) + 3
"""Number of other frictions."""
BETTER = 1.0
"""Decrease of the cost from which a larger friction is a rival, and increase up to which a larger friction holds as well."""
LOWER = 0.0
"""Decrease of the cost from which a smaller friction is a rival of an unknown one. Equal costs give it a weight of about 3 %, the share of
the prior in which friction slips a little."""
EXCLUDED = 12.0
"""Difference of costs from which a smaller friction is a rival of a known one, and a value is excluded: 3.5 standard deviations."""
NOTHING = 0.01
"""Information from slopes over information before, below which slopes are not checked."""
TELLING = 2.0
"""Squared distance over the variance by the slopes from which the cost there can confirm the slopes."""
POSSIBLE = 9.0
"""Increase of the cost up to which a friction counts in this check: three standard deviations."""
LEAST = 0.04
"""Smallest share of the slopes' information that counts: intervals grow five times at the most."""


@dataclass(frozen=True)
class Verdict:
    """Comparison of an estimate with other frictions.

    Attributes:
        rival: Index of the point whose friction explains the window best, as a rival; None if there is none.
        holding: Indices of frictions that hold: the window has no slope in them.
        excluded: Largest value that is excluded, by the index of the friction.
        rises: Of frictions that do not hold, distances of the other values, and by how much they raise the cost, (k, 2).
    """

    rival: int | None
    holding: list[int]
    excluded: dict[int, float]
    rises: dict[int, Array]


def tried(x: float, std: float, bound: float) -> Array:
    """Other frictions to compare with x, (TRIED,)."""
    last = bound + ABOVE_BOUND if math.isfinite(bound) else x + 2 * OTHERS[0]
    near = float(np.clip(NEAR * std, NEAREST, -OTHERS[1] / 2))
    return np.array([*(x + step for step in (*OTHERS, -near, near)), last])


def judged(
    kinked: list[int], unknown: list[bool], *, points: Array, residual: Array, J: Array, mean: Array, cov: Array, first: int
) -> Verdict:
    """Verdict of other frictions on an estimate.

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
    """Share of the slopes' information on a friction that costs farther away confirm, from `LEAST` to 1.

    Where friction begins to slip, the cost rises less towards larger values than the slope at the estimate predicts.

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
    """Covariance with only a share of the information on a friction that was gained since a variance; other numbers widen along with it."""
    after = float(covariance[j, j])
    gained = 1 / after - 1 / before
    if share >= 1 or gained <= 0:
        return covariance
    variance = 1 / (1 / before + share * gained)
    along = covariance[:, j] / after
    return np.asarray(covariance + (variance - after) * np.outer(along, along))


def _profiles(j: int, points: Array, residual: Array, *, J: Array, mean: Array, cov: Array) -> tuple[Array, Array]:
    """Costs of points with other values of the friction j, minimised over all other numbers by the slopes.

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

    An unknown friction holds if the largest value predicts the same. A known one may slip a little where the true one does not: it counts
    as holding if the largest value explains the window as well, unless that slides too.
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
