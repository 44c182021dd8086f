"""Comparison of an estimated friction with other values, by predictions of the window of readings.

While an object sticks, the readings have no slope with respect to friction: a larger value changes nothing, and a much smaller one would
slip. Each window is therefore also predicted with other frictions. They show whether the object sticks, and which values are excluded. They
also show whether another value is a rival of the estimate, and how much information of the slopes is reliable.
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
"""Distance of another friction from the lower bound, as a logarithm: the bound can rise by it at every comparison."""
CLOSE = 0.025
"""Largest distance of consecutive values in an excluded range, as a logarithm. At the onset of slip, minima are 0.05 wide."""
OTHERS_PER_FRICTION = len(OTHERS) + 3
"""Number of other values that are compared with each friction."""
BETTER = 1.0
"""Decrease of the cost from which a larger friction is a rival, and increase up to which a larger friction holds as well."""
LOWER = 0.0
"""Decrease of the cost from which a smaller friction is a rival of an unknown one. Equal costs give it a weight of about 3 %, the share of
the prior in which friction slips a little."""
EXCLUDED = 12.0
"""Difference of costs from which a smaller friction is a rival of a known one, and a value is excluded: 3.5 standard deviations."""
LEAST_GAIN = 0.01
"""Information from slopes, relative to the information before, below which slopes are not checked."""
LEAST_DISTANCE = 2.0
"""Squared distance, relative to the variance by the slopes, from which the cost of another friction counts in this check."""
POSSIBLE = 9.0
"""Increase of the cost up to which another friction counts in this check: three standard deviations."""
LEAST = 0.04
"""Smallest share of the slopes' information that is kept: intervals become at most five times as wide."""


@dataclass(frozen=True)
class Verdict:
    """Comparison of an estimate with other frictions.

    Attributes:
        rival: Index of the point whose friction explains the window best, as a rival; None if there is none.
        holding: Indices of frictions at which the object sticks, so that the window has no slope with respect to them.
        excluded: Largest value of the excluded range, by the index of the friction.
        rises: Distance of each other value and its increase of the cost, (k, 2), by the index of a friction at which the object slips.
    """

    rival: int | None
    holding: list[int]
    excluded: dict[int, float]
    rises: dict[int, Array]


def other_frictions(x: float, std: float, bound: float) -> Array:
    """Other values to compare with a friction x, (OTHERS_PER_FRICTION,), logarithms."""
    last = bound + ABOVE_BOUND if math.isfinite(bound) else x + 2 * OTHERS[0]
    near = float(np.clip(NEAR * std, NEAREST, -OTHERS[1] / 2))
    return np.array([*(x + step for step in (*OTHERS, -near, near)), last])


def verdict_of(
    kinked: list[int], unknown: list[bool], *, points: Array, residual: Array, J: Array, mean: Array, root: Array, first: int
) -> Verdict:
    """Compares an estimate with other values of its frictions.

    Args:
        kinked: Indices of frictions.
        unknown: Whether the readings before the window leave each of them undetermined.
        points: The estimate and all other points, (count, N).
        residual: Residuals of the points over their noise, (count, T, width).
        J: Derivatives at the estimate, (T, width, N).
        mean: Mean of the arrival cost, (N,).
        root: Root of its covariance, (N, N).
        first: Index of the first point with another friction.
    """
    rival, gain, holding = None, 0.0, []
    excluded: dict[int, float] = {}
    rises: dict[int, Array] = {}
    whitening = np.asarray(np.linalg.inv(root), np.float64)
    for k, j in enumerate(kinked):
        index = np.array([0, *range(first + k * OTHERS_PER_FRICTION, first + (k + 1) * OTHERS_PER_FRICTION)])
        values = points[index, j]
        window, known = _profiles(j, points[index], residual[index], J=J, mean=mean, whitening=whitening)
        if (end := excluded_end(values, window)) is not None:
            excluded[j] = end
        if _holds(residual[index], values, window, unknown=unknown[k]):
            holding.append(j)
        else:
            rises[j] = np.stack([values - values[0], known - known[0]], axis=1)
        needed = np.where(values < values[0], LOWER if unknown[k] else EXCLUDED, BETTER)
        excess = known[0] - known - needed
        if excess.max() > gain:
            rival, gain = int(index[excess.argmax()]), float(excess.max())
    return Verdict(rival, holding, excluded, rises)


def excluded_end(values: Array, costs: Array) -> float | None:
    """Largest value of the excluded range that begins with the smallest value; None if the smallest value is possible.

    At the onset of slip, the cost can have two minima with a rise between them, and the true value can lie at the first. The range
    therefore ends before the first possible value, and where the distance of two values could hide a minimum.

    Args:
        values: Values of a friction, (count,), logarithms.
        costs: Their costs, (count,).
    """
    order = np.argsort(values)
    possible = costs[order] <= costs.min() + EXCLUDED
    possible[1:] |= np.diff(values[order]) > CLOSE
    first = int(possible.argmax())
    return float(values[order[first - 1]]) if first else None


def share_of(rises: Array, step: float, *, before: float, after: float) -> float:
    """Share of the slopes' information on a friction that the costs of other values confirm, from `LEAST` to 1.

    At the onset of slip, the cost rises less towards larger values than the slope at the estimate predicts.

    Args:
        rises: Distances of other values from the estimate, and their increases of the cost, (k, 2).
        step: Distance of the smallest cost from the estimate, by the slopes.
        before: Variance of the friction before the window.
        after: Variance by the slopes.
    """
    gained = 1 / after - 1 / before
    if gained * before < LEAST_GAIN:
        return 1.0
    shares = []
    for apart, rise in rises:
        if apart**2 < LEAST_DISTANCE * after or rise > POSSIBLE:
            continue
        share = ((rise + 2 * apart * step / after) / apart**2 - 1 / before) / gained
        # An interval of two standard deviations need not reach farther than the next value that is not possible.
        beyond = [abs(other) for other, cost in rises if other / apart > 1 and cost > POSSIBLE]
        if beyond:
            share = max(share, ((2 / min(beyond)) ** 2 - 1 / before) / gained)
        shares.append(share)
    return float(np.clip(min(shares, default=1.0), LEAST, 1.0))


def widened(covariance: Array, j: int, before: float, share: float) -> Array:
    """Covariance that keeps only a share of the information gained on a friction j since its variance was `before`, (N, N).

    Variances of correlated numbers increase accordingly.
    """
    after = float(covariance[j, j])
    gained = 1 / after - 1 / before
    if share >= 1 or gained <= 0:
        return covariance
    variance = 1 / (1 / before + share * gained)
    along = covariance[:, j] / after
    return np.asarray(covariance + (variance - after) * np.outer(along, along))


def _profiles(j: int, points: Array, residual: Array, *, J: Array, mean: Array, whitening: Array) -> tuple[Array, Array]:
    """Costs of points with other values of the friction j, minimised over all other numbers by the slopes.

    Without prior knowledge of the friction, the arrival cost is that of the other numbers alone: its minimum over the friction.

    Args:
        j: Index of the friction.
        points: The estimate and points with other values of the friction, (count, N).
        residual: Residuals of the points over their noise, (count, T, width).
        J: Derivatives at the estimate, (T, width, N).
        mean: Mean of the arrival cost, (N,).
        whitening: Inverse root of its covariance, (N, N).

    Returns:
        Costs without prior knowledge of the friction, and with it, (count,) each.
    """
    N = points.shape[1]
    left = residual.reshape(len(points), -1)
    others = np.delete(np.arange(N), j)
    slope = J.reshape(-1, N)[:, others]
    rows = np.concatenate([slope, whitening[:, others]])
    free = np.concatenate([np.zeros(len(slope)), whitening[:, j]])
    apart = np.concatenate([left, (points - mean) @ whitening.T], axis=1)
    return _least(np.column_stack([rows, free]), apart), _least(rows, apart)


def _holds(residual: Array, values: Array, window: Array, *, unknown: bool) -> bool:
    """Whether the object sticks at the estimated friction, which is the first of the points.

    An undetermined friction sticks if the largest value predicts the same readings. A determined friction may slip a little where the true
    one sticks. It counts as sticking if the largest value explains the window equally well and also sticks.
    """
    *_, second, largest = np.argsort(values)
    if unknown:
        return _same(residual[0], residual[largest])
    return bool(window[largest] <= window.min() + BETTER) and _same(residual[second], residual[largest])


def _same(one: Array, other: Array) -> bool:
    return float(((one - other) ** 2).sum()) < FLAT


def _least(A: Array, b: Array) -> Array:
    """Squared distances of the rows of b, (count, m), from the column space of A, (m, k): (count,)."""
    Q = np.linalg.qr(A / np.linalg.norm(A, axis=0))[0]
    return np.asarray((b**2).sum(axis=1) - ((b @ Q) ** 2).sum(axis=1))
