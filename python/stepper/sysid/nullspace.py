"""Null space of the data: directions of the parameters along which the predicted readings stay the same.

The null space of the Jacobian at an estimate is only the tangent of a curved set of equally good estimates. Of a pendulum, data determine
the product of mass and distance, and mass and distance change in opposite directions. Where a moment of inertia vanishes, the tangent even
lies along that moment alone, so that the mass seems to be determined. Therefore:

- The estimate is moved along the set to the point that is nearest to the start values. Parameters that the data do not determine thus keep
  their start values as far as the data allow.
- Null spaces are computed there and at other points of the set, about one scale away (`Block.scale`, the unit of all lengths here).
- The ends of other searches (minima.py) belong to the set too, unless they are significantly worse (`SIGNIFICANT`). Of a pendulum with a
  known shape, data determine first moments and moment of inertia, and two masses fit these. A search that hugs a bound may stop on the
  slope of a valley, where even determined values are several standard deviations off. Gauss-Newton steps move each end to the bottom.
- A value is determined only if it is equal at all these points. Its derivative along their null spaces must be zero too, within its
  standard deviation.

Weak directions, along which the standard deviation is large, are curved too. Each is followed to the points where the sum of squared
residuals has risen by 4. If these points are farther than two standard deviations, the covariance is increased to reach them.

Along some weak directions the sum rises to a limit only, as along the logarithm of a scale towards zero. Of scale and bias, a finite
interval is right only if the scale differs significantly from zero (Fieller 1954). Intervals that are always finite cannot have their
level (Gleser and Hwang 1987, Dufour 1997). If a rise by 4 sufficed, noise would cause finite intervals in 2 % of the runs, which would
miss the truth. Therefore the sum must rise by 16 before a direction counts as determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.residuals import Linearized, Residuals

FLAT_STD = 3.0
"""Standard deviation along a direction, in units of the scales, above which the direction belongs to the null space.

The 95 % interval of a positive parameter along it spans a factor of 400 up and down, of the 1000 that default bounds allow.
"""
FLAT_EXCESS = 1.0
"""Largest increase of the sum of squared residuals, in units of the noise, at which a point explains the readings equally well."""
EQUAL_FIT = 4.0
"""Difference of the sums of squared residuals, in units of the noise, below which the minimum nearest to the start values is the estimate.

Noise alone can cause this difference: it is that of two standard deviations. Minima up to `SIGNIFICANT` are not excluded.
"""
OTHERS = 2
"""Number of further points of the set of equally good estimates at which the null space is computed."""
WALK = 16
"""Largest number of steps of a walk along the set of equally good estimates."""
CORRECTIONS = 4
"""Largest number of Gauss-Newton steps that return to the set after a step along its tangent."""
SHORTEST = 0.03
"""Length of a step along the set below which a walk ends, in units of the scales."""
WEAK_STD = 0.1
"""Standard deviation along a direction, in units of the scales, above which the cost is followed along the direction."""
END = 4.0
"""Increase of the sum of squared residuals, in units of the noise, at the ends of a 95 % interval: two standard deviations."""
SIGNIFICANT = 16.0
"""Increase of the sum of squared residuals, in units of the noise, below which a weak direction has no end: four standard deviations.

It is also the increase up to which another minimum is not excluded.

Of a parameter without effect, noise alone causes this increase in one of 30,000 runs. A positive parameter in which the readings are linear
is thus determined if its standard deviation is less than a quarter of it. A significant end is at an increase of `END`.
"""
FOLLOWED = 12
"""Largest number of steps along a weak direction, of at most `STRIDE`. A direction without an end there is not determined."""
CORRECTED = 0.1
"""Decrease of the sum of squared residuals by a further correction, in units of the noise, below which a point is in the valley."""
STRIDE = 0.5
"""Largest step along a weak direction, in units of the scales."""
OUTSIDE = 3.0
"""Distance of a value at another equally good estimate, in standard deviations, above which the value is not determined."""
ROUNDING = 1e-6
"""Change of a value along a null space that rounding may cause, relative to the change by one unit of a parameter's scale."""


def cost_ratio(residuals: Residuals, rise: float) -> float:
    """Ratio of the costs of two minima whose sums of squared residuals differ by `rise`, in units of the noise."""
    return 1 + rise / residuals.count


@dataclass(frozen=True)
class Point:
    """Point of the set of equally good estimates, with its null space.

    Attributes:
        x: Point, (n + starts,), in units of the scales.
        at: Residuals and Jacobian at x.
        null: Orthonormal basis of the null space, its n coordinates of the parameters, (n, q).
        spurious: Norm of the difference between two finite-difference Jacobians along each null direction, (q,).
        covariance: Covariance of the parameters for white noise with the coordinates along the null space fixed, (n, n).
        effect: Norm of the derivatives of all readings with respect to each parameter, in standard deviations of their noise, (n,).
        roughness: Relative differences between derivatives with a finite-difference step and with twice that step, (n,).
    """

    x: Array
    at: Linearized
    null: Array
    spurious: Array
    covariance: Array
    effect: Array
    roughness: Array


class FlatSet:
    """Set of estimates that explain the readings as well as a given one.

    Args:
        residuals: Residuals of the fit.
        x: Estimate, (n + starts,).
        at: Residuals and Jacobian at the estimate.
        rivals: Other minima that are not significantly worse, (n + starts,) each.

    Attributes:
        points: Equally good estimates. The first one is nearest to the start values.
        widening: Increase of the covariance of the parameters, in units of the scales, because weak directions are curved, (n, n).
    """

    def __init__(self, residuals: Residuals, x: Array, at: Linearized, rivals: Sequence[Array] = ()):
        self._residuals = residuals
        self._least = self._cost(at)
        self._unit = max(1.0, self._least / max(len(at.residual) - len(x), 1))
        self.points: list[Point] = []
        first = self._point(x, at)
        if first.null.shape[1]:
            first = self._polished(*self._walk(x, at, residuals.start[: residuals.n]))
        self.points = [first]
        rng = np.random.default_rng(0)
        for _ in range(OTHERS if first.null.shape[1] else 0):
            target = first.x[: residuals.n] + rng.choice([-1.0, 1.0], residuals.n) * rng.uniform(0.5, 1.5, residuals.n)
            self.points.append(self._point(*self._walk(first.x, first.at, target)))
        self.points += [self._polished(x, at) for x, at in zip(rivals, residuals.linearize(rivals), strict=True)] if rivals else []
        self.widening = self._follow_weak(first)

    def undetermined(self, values: Array, slopes: Array, std: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Mask of p functions of the parameters that the data do not determine, (p,).

        Args:
            values: Values of the functions at the points, (points, p), in the units of the functions.
            slopes: Derivatives with respect to x at the points, (points, p, n).
            std: Standard deviations at the first point, (p,).
        """
        out = np.zeros(len(std), bool)
        for point, value, slope in zip(self.points, values, slopes, strict=True):
            rounding = ROUNDING * np.linalg.norm(slope, axis=1)
            own = np.sqrt(np.einsum("ij,jk,ik->i", slope, point.covariance, slope))
            along = np.abs(slope @ point.null) / np.maximum(1.0, point.spurious)
            out |= (along > np.maximum(own, rounding)[:, None]).any(axis=1)
            out |= np.abs(value - values[0]) > OUTSIDE * std + rounding
        return out

    def _follow_weak(self, first: Point) -> Array:
        """Increase of the covariance of the parameters, (n, n), because weak directions are curved.

        If a direction has no end, the last point that was reached along it is added to `points`.
        """
        n = self._residuals.n
        squares, axes = np.linalg.eigh(first.covariance)
        widening = np.zeros((n, n))
        for std, axis in zip(np.sqrt(np.maximum(squares, 0.0)), axes.T, strict=True):
            ends = [np.zeros(n)]
            for sign in (-1.0, 1.0) if std > WEAK_STD else ():
                end, point = self._end(first, sign * axis, std)
                if point is not None:
                    self.points.append(point)
                    continue
                ends.append(sign * (end - first.x[:n]) / 2)
            *others, farthest = sorted(ends, key=lambda end: float(end @ axis))
            if float(farthest @ axis) > std:
                widening += np.outer(farthest, farthest) - std**2 * np.outer(axis, axis)
            for end in others:
                across = end - axis * float(end @ axis)
                widening += np.outer(across, across)
        return widening

    def _end(self, first: Point, axis: Array, std: float) -> tuple[Array, Point | None]:
        """Parameters, (n,), where the cost along a weak direction has risen by `END` or a bound is reached.

        The direction `axis`, (n,), begins at the point `first`, with the standard deviation `std` along it. If the cost does not rise by
        `SIGNIFICANT` and no bound is reached, the last point along the direction is returned too.
        """
        low, high = self._residuals.low, self._residuals.high
        x, ahead, excess = first.x, np.concatenate([axis, np.zeros(len(first.x) - len(axis))]), 0.0
        stride, end = min(STRIDE, std), None
        for _ in range(FOLLOWED):
            other = x + stride * ahead
            clipped = np.clip(other, low, high)
            for left in range(CORRECTIONS, -1, -1):
                (at,) = self._residuals.linearize([clipped])
                if not np.isfinite(at.residual).all() or not np.isfinite(at.jacobian).all():
                    return clipped[: len(axis)], None
                step = self._split(at, across=ahead)[1]
                gain = float(((at.jacobian @ step) ** 2).sum())
                if not left or gain < CORRECTED * self._unit:
                    break
                clipped = np.clip(clipped + step * min(1.0, STRIDE / max(float(np.abs(step).max()), 1e-300)), low, high)
            if gain > END * self._unit:  # The valley is too curved for this stride.
                stride /= 2
                continue
            risen = max((self._cost(at) - self._least) / self._unit, 0.0)
            if risen > END and end is None:
                share = (END**0.5 - excess**0.5) / (risen**0.5 - excess**0.5)
                end = (x + share * (clipped - x))[: len(axis)]
            if end is not None and risen > SIGNIFICANT:
                return end, None
            moved = clipped - x
            if float(np.linalg.norm(moved)) < SHORTEST * stride:
                return clipped[: len(axis)], None
            x, ahead, excess = clipped, moved / np.linalg.norm(moved), risen
            if end is not None:  # Beyond the end, only the height of the rise matters.
                stride = min(STRIDE, 2 * stride)
        return x[: len(axis)], self._point(x, at)

    def _cost(self, at: Linearized) -> float:
        """Sum of squared residuals."""
        return float((at.residual**2).sum())

    def _split(self, at: Linearized, change: Array | None = None, across: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """Null space of a Jacobian, (n + starts, q), and the Gauss-Newton step orthogonal to it, with their uncertainty.

        Args:
            at: Residuals and Jacobian.
            change: Difference of the Jacobian from one with another finite-difference step.
            across: Direction, (n + starts,), along which the step has no component.

        Returns:
            Null space, Gauss-Newton step, norm of `change` along each null direction, and the root of the covariance orthogonal to the
            null space, (n + starts, k).
        """
        J = at.jacobian if across is None else at.jacobian - np.outer(at.jacobian @ across, across)
        U, S, Vt = np.linalg.svd(J, full_matrices=False)
        noise = np.zeros(len(S)) if change is None else np.linalg.norm(change @ Vt.T, axis=0)
        flat = np.maximum(1 / FLAT_STD, noise) > S
        root = Vt[~flat].T / S[~flat]
        return Vt[flat].T, -root @ (U[:, ~flat].T @ at.residual), noise[flat], root

    def _point(self, x: Array, at: Linearized) -> Point:
        """Point of the set with its null space, from two finite-difference Jacobians."""
        (twice,) = self._residuals.linearize([x], 2 * self._residuals.step)
        change = at.jacobian - twice.jacobian
        null, _, noise, root = self._split(at, change)
        n = self._residuals.n
        effect, differs = (np.linalg.norm(J[: at.data, :n], axis=0) for J in (at.jacobian, change))
        return Point(x, at, null[:n], noise, self._unit * root[:n] @ root[:n].T, effect, differs / np.where(effect > 0, effect, 1.0))

    def _walk(self, x: Array, at: Linearized, target: Array) -> tuple[Array, Linearized]:
        """End of a walk along the set towards the parameters `target`, (n,), and the residuals there."""
        length = 1.0
        for _ in range(WALK):
            null = self._split(at)[0]
            along = null @ (null[: len(target)].T @ (target - x[: len(target)]))
            size = float(np.abs(along).max(initial=0.0))
            if size < SHORTEST or length < SHORTEST:
                break
            found = self._corrected(x + along * min(1.0, length / size))
            length = min(1.0, 2 * length) if found else length / 4
            x, at = found or (x, at)
        return x, at

    def _corrected(self, x: Array) -> tuple[Array, Linearized] | None:
        """Point of the set near x, and the residuals there; None if Gauss-Newton steps find none."""
        for _ in range(CORRECTIONS + 1):
            x = np.clip(x, self._residuals.low, self._residuals.high)
            (at,) = self._residuals.linearize([x])
            if not np.isfinite(at.residual).all() or not np.isfinite(at.jacobian).all():
                return None
            if self._cost(at) - self._least < FLAT_EXCESS * self._unit:
                return x, at
            step = self._split(at)[1]
            x = x + step * min(1.0, 1 / max(float(np.abs(step).max()), 1e-300))
        return None

    def _polished(self, x: Array, at: Linearized) -> Point:
        """Point with the smallest cost near x, without a move along the null space."""
        for _ in range(CORRECTIONS):
            step = self._split(at)[1]
            other = np.clip(x + step, self._residuals.low, self._residuals.high)
            (there,) = self._residuals.linearize([other])
            if not self._cost(there) < self._cost(at):
                break
            x, at = other, there
        return self._point(x, at)
