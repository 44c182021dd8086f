"""Comparison of an estimated friction with other values, by predictions of the window of readings.

While an object sticks, the derivative of the readings with respect to friction is zero: a larger value changes nothing, and a much smaller
one would slip. Each window is therefore also simulated with other frictions. The results show whether the object sticks, and which values
the readings exclude. They also show whether another value is a rival of the estimate (it explains the readings equally well), and how much
information of the derivatives is reliable.

Frictions are logarithms throughout. The cost of a friction is a sum of squares, minimised over all other unknowns. The terms are residuals
in units of the noise, and deviations of the unknowns from their mean before the window, in standard deviations.

Arrays of residuals are (count, T, width): simulated points, samples of the window, and columns of all channels of the readings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from stepper.sysid.inertia import Array

WIDE = 0.3
"""Standard deviation above which a parameter counts as unknown, in units of its scale."""
FLAT = 0.01
"""Sum of squared differences of residuals, in units of the noise, below which predictions with two frictions count as the same."""
KINKED = (*(f"{field}_friction[{column}]" for field in ("geom", "pair") for column in range(3)), "dof_frictionloss")
"""Kinds of friction parameters. While nothing slides, the readings do not depend on them."""
OTHERS = (-0.5, -0.15, 0.15, 0.5)
"""Differences of log(friction) between compared values and the estimate."""
NEAR = 2.5
"""Distance from the estimated log(friction) to the two nearest compared values, in standard deviations of the estimate."""
NEAREST = 0.005
"""Lower bound of the distance from the estimated log(friction) to the two nearest compared values."""
ABOVE_BOUND = 0.02
"""Difference of log(friction) between the lower bound of a friction and a value that is compared with the estimate.

If the readings exclude this value, it becomes the new lower bound.
"""
CLOSE = 0.025
"""Largest difference of log(friction) between two neighbouring compared values in a range that the readings exclude.

At the onset of slip, minima of the cost are 0.05 wide, so that two values farther apart could have a minimum between them.
"""
OTHERS_PER_FRICTION = len(OTHERS) + 3
"""Number of values compared with the estimate of each friction: at fixed offsets, two near the estimate, one above the lower bound."""
BETTER = 1.0
"""Difference of two costs (sums of squares, see the module) above which the friction with the lower cost explains the readings better.

A larger friction whose cost is lower than the estimate's cost by more than this is a rival (an alternative) of the estimate.
"""
LOWER = 0.0
"""Decrease of the cost (sum of squares, see the module) above which a smaller friction is a rival of an undetermined estimate.

A rival is another friction that explains the readings equally well, so that it becomes a second hypothesis.
At equal costs, the hypothesis with the smaller friction gets a weight of about 3 %. This is the fraction of the prior in which the object
slips a little.
"""
EXCLUDED = 12.0
"""Increase of the cost (sum of squares, see the module) over its minimum above which the readings exclude a friction.

It corresponds to 3.5 standard deviations. A smaller friction whose cost is lower than the estimate's cost by more than this is a rival (an
alternative) of a determined estimate.
"""
LEAST_GAIN = 0.01
"""Relative gain of information about a friction in a window below which `share_of` accepts the derivatives without a check."""
LEAST_DISTANCE = 2.0
"""Squared distance from the estimate below which `share_of` ignores a compared friction, in units of the friction's variance."""
POSSIBLE = 9.0
"""Increase of the cost below which the readings allow a value of friction: three standard deviations."""
LEAST_SHARE = 0.04
"""Lower bound of the fraction that `share_of` returns. Intervals become at most five times as wide."""
TWO_SIDED = 1.96
"""Half width of a 95 % interval, in standard deviations."""
_NORMAL = NormalDist()


@dataclass(frozen=True)
class Verdict:
    """Result of a comparison of the estimated frictions with other values.

    Attributes:
        rival: Index of the simulated point whose friction explains the readings as well as the estimate or better; None if there is none.
        holding: Indices of the frictions that hold their object at the estimate, so that the derivatives with respect to them are zero.
        excluded: Largest value of a friction that the readings exclude, as a logarithm, by index of the friction. They exclude all smaller
            values too.
        rises: Arrays (k, 2) by index of the friction, for frictions that are not in `holding`. Each row has the offset of a compared value
            from the estimate (a difference of logarithms), and the increase of the cost at this value.
    """

    rival: int | None
    holding: list[int]
    excluded: dict[int, float]
    rises: dict[int, Array]


def other_frictions(x: float, std: float, bound: float) -> Array:
    """Values to compare with an estimated friction, (OTHERS_PER_FRICTION,), as logarithms.

    Args:
        x: Estimate of the friction, as a logarithm.
        std: Standard deviation of the estimate.
        bound: Largest value that the readings exclude, as a logarithm; -inf if they exclude none.
    """
    last = bound + ABOVE_BOUND if math.isfinite(bound) else x + 2 * OTHERS[0]
    near = float(np.clip(NEAR * std, NEAREST, -OTHERS[1] / 2))
    return np.array([*(x + step for step in (*OTHERS, -near, near)), last])


def verdict_of(
    kinked: list[int], unknown: list[bool], *, points: Array, residual: Array, J: Array, mean: Array, root: Array, first: int
) -> Verdict:
    """Compares the estimate of a window of samples with points that have other values of friction.

    The arrival cost is the normal distribution of the N unknowns (parameters and initial state) before the window.

    Args:
        kinked: Indices of the frictions.
        unknown: Whether each friction was undetermined before the window.
        points: The estimate and all other simulated points, (count, N).
        residual: Residuals at the points, in units of the noise, (count, T, width).
        J: Derivatives at the estimate, (T, width, N).
        mean: Mean of the arrival cost, (N,).
        root: Square root of the arrival cost's covariance, (N, N).
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
    """Largest friction that the readings exclude together with all smaller values; None if they allow the smallest compared value.

    At the onset of slip, the cost can have two minima with a rise between them, and the true value can lie at the first. The excluded
    range therefore ends before the first value that the readings allow. It also ends before a gap wider than `CLOSE` between two
    compared values, which could hide a minimum.

    Args:
        values: Compared values of a friction, (count,), logarithms.
        costs: Costs of the values, (count,).
    """
    order = np.argsort(values)
    possible = costs[order] <= costs.min() + EXCLUDED
    possible[1:] |= np.diff(values[order]) > CLOSE
    first = int(possible.argmax())
    return float(values[order[first - 1]]) if first else None


def share_of(rises: Array, step: float, *, before: float, after: float) -> float:
    """Reliable fraction of the information about a friction that derivatives give, from `LEAST_SHARE` to 1.

    The derivatives at the estimate predict by how much the cost rises at other values of the friction. At the onset of slip, the cost
    rises less towards larger values. The fraction compares the actual rise with the predicted one.

    Args:
        rises: Offsets of compared values from the estimate, and increases of the cost at these values, (k, 2).
        step: Offset of the minimum of the cost from the estimate, as the derivatives predict it.
        before: Variance of the friction before the window.
        after: Variance of the friction according to the derivatives.
    """
    gained = 1 / after - 1 / before
    if gained * before < LEAST_GAIN:
        return 1.0
    shares = []
    for apart, rise in rises:
        if apart**2 < LEAST_DISTANCE * after or rise > POSSIBLE:
            continue
        share = ((rise + 2 * apart * step / after) / apart**2 - 1 / before) / gained
        # The fraction is raised until two standard deviations reach at most to the nearest value with a cost above `POSSIBLE`.
        beyond = [abs(other) for other, cost in rises if other / apart > 1 and cost > POSSIBLE]
        if beyond:
            share = max(share, ((2 / min(beyond)) ** 2 - 1 / before) / gained)
        shares.append(share)
    return float(np.clip(min(shares, default=1.0), LEAST_SHARE, 1.0))


def truncated_normal(low: float) -> tuple[float, float, float]:
    """95 % interval (lower end, upper end) of a standard normal distribution that is cut off below `low`, and the probability above `low`.

    `low` is in standard deviations from the mean. The probability is that of the distribution before it was cut off.
    The probability is at least 1e-9, where the quantiles are still accurate.
    """
    share = max(_NORMAL.cdf(-low), 1e-9)
    return -_NORMAL.inv_cdf(0.975 * share), -_NORMAL.inv_cdf(0.025 * share), share


def widened(covariance: Array, j: int, before: float, share: float) -> Array:
    """Covariance, (N, N), in which a friction keeps only a part of the information that was gained about it.

    Variances of correlated numbers increase accordingly.

    Args:
        covariance: Covariance, (N, N).
        j: Index of the friction.
        before: Variance of the friction before the information was gained.
        share: Fraction of the gained information that is kept.
    """
    after = float(covariance[j, j])
    gained = 1 / after - 1 / before
    if share >= 1 or gained <= 0:
        return covariance
    variance = 1 / (1 / before + share * gained)
    along = covariance[:, j] / after
    return np.asarray(covariance + (variance - after) * np.outer(along, along))


def _profiles(j: int, points: Array, residual: Array, *, J: Array, mean: Array, whitening: Array) -> tuple[Array, Array]:
    """Costs of several values of a friction, each minimised over all other unknowns (profile costs).

    The arrival cost is the normal distribution of the unknowns before the window. A cost is the sum of squared residuals and of squared
    deviations from the arrival cost's mean, in standard deviations. Derivatives give the effect of the other unknowns on the residuals.
    A cost without prior knowledge of the friction leaves out the friction's deviation from its mean. It is computed by minimising over this
    deviation too.

    Args:
        j: Index of the friction.
        points: The estimate and points with other values of the friction, (count, N).
        residual: Residuals at the points, in units of the noise, (count, T, width).
        J: Derivatives at the estimate, (T, width, N).
        mean: Mean of the arrival cost, (N,).
        whitening: Inverse square root of the arrival cost's covariance, (N, N).

    Returns:
        Costs without and with prior knowledge of the friction, (count,) each.
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
    """Whether an object sticks at the estimate of a friction.

    If the friction was undetermined before the window, the object sticks if the largest compared value gives the same prediction as the
    estimate. If it was determined, the simulated object may slip a little at the estimate although the real one sticks. The object then
    counts as sticking if the two largest values give the same prediction, which explains the window as well as any other.

    Args:
        residual: Residuals at the estimate (first) and at points with other values of the friction, (count, T, width).
        values: Values of the friction at these points, (count,), logarithms.
        window: Costs of these points, (count,).
        unknown: Whether the friction was undetermined before the window.
    """
    *_, second, largest = np.argsort(values)
    if unknown:
        return _same(residual[0], residual[largest])
    return bool(window[largest] <= window.min() + BETTER) and _same(residual[second], residual[largest])


def _same(one: Array, other: Array) -> bool:
    """Whether the sum of the squared differences of two residual arrays, (T, width), is below `FLAT`."""
    return float(((one - other) ** 2).sum()) < FLAT


def _least(A: Array, b: Array) -> Array:
    """Squared distances of the rows of b, (count, m), from the column space of A, (m, k), by least squares: (count,)."""
    Q = np.linalg.qr(A / np.linalg.norm(A, axis=0))[0]
    return np.asarray((b**2).sum(axis=1) - ((b @ Q) ** 2).sum(axis=1))
