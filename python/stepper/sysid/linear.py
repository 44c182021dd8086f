"""Derivatives by finite differences as wide as the distribution of the unknowns, which average over kinks of the readings.

Where a contact begins, readings have kinks that are closer together than the uncertainty of the state. The derivative at one point
would belong to one smooth piece, and would overstate the information of the readings. The second-order divided-difference filter avoids
this (Norgaard, Poulsen and Ravn 2000). It takes differences above and below the estimate along the columns of a root of the covariance,
sqrt(3) standard deviations long. Half the difference is the derivative along the column. Curvature shifts the mean of the readings, and the
rest of its effect counts as noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.residuals import slopes
from stepper.sysid.uncertainty import RIDGE, root_of

LENGTH = math.sqrt(3.0)
"""Half width of a finite difference, in standard deviations.

With sqrt(3), the points match a normal distribution up to its fourth moments.
"""


class Directions:
    """Directions and widths of finite differences about an estimate x, from the covariance of x.

    Args:
        covariance: Covariance of x, (n, n).
        local: Smallest half widths of finite differences, (n,), in the unit of x.
        clearance: Distance from x to its nearest bound, (n,), in the unit of x; infinite without bounds.
        apart: Indices of the components of x that are varied one at a time, each by its half width in `local`. The directions of the
            other components are the columns of a square root of their conditional covariance.
        leading: Indices of components of x, such as frictions, that do not change along the directions of the other components.
            Otherwise a change of a mass would also change a correlated friction, and an object that sticks could slip. The derivative
            with respect to the mass would then include the effect of the slip.

    Attributes:
        columns: Directions, (n, n), one per column.
    """

    def __init__(self, covariance: Array, local: Array, clearance: Array, apart: Sequence[int], leading: Sequence[int] = ()):
        n = len(local)
        self._local, self._apart = local, list(apart)
        rest = sorted((j for j in range(n) if j not in self._apart), key=lambda j: j not in leading)
        self.columns = np.zeros((n, n))
        self.columns[self._apart, self._apart] = local[self._apart]
        if rest:
            self.columns[np.ix_(rest, rest)] = LENGTH * root_of(_given(covariance, rest), RIDGE)
        for c in rest:
            column = self.columns[:, c]
            narrow = np.abs(column / local).max()
            wide = (np.abs(column) / np.maximum(clearance, local)).max()
            column *= (1.0 if narrow >= 1 else 1 / max(narrow, 1e-300)) / max(wide, 1.0)

    def points(self, x: Array) -> Array:
        """Points above and below a point along each direction, in the unit of the point.

        Args:
            x: The point, (n,), in the units of the parameters.

        Returns:
            The points, (2 n, n): for each direction the point above x, then that below.
        """
        out = np.repeat(x[None], 2 * len(x), axis=0)
        out[::2] += self.columns.T
        out[1::2] -= self.columns.T
        return out

    def derivative(self, y: Array, spans: Array) -> tuple[Array, Array]:
        """Derivatives with respect to x, (n, T, width), and curvature terms along each direction, (n, T, width).

        Args:
            y: Values at x, and at all of `points`, (1 + 2 n, T, width), in any unit.
            spans: Widths of the local differences above and below, (n, 2), in the unit of x.
        """
        above, below = y[1::2], y[2::2]
        along, curved = (above - below) / 2, (above + below - 2 * y[0]) / math.sqrt(18.0)
        if self._apart:
            steps = self._local[self._apart][:, None, None]
            along[self._apart] = slopes(y, spans)[self._apart] * steps
            curved[self._apart] = 0.0
        found = np.linalg.solve(self.columns.T, along.reshape(len(along), -1))
        return np.asarray(found.reshape(along.shape)), np.asarray(curved)


def mean_shift(curved: Array) -> Array:
    """Mean of a function over the distribution of the unknowns, minus the function at the estimate, (T, width), in the function's unit.

    The result is exact for quadratic functions. Without this correction, a kink of the readings shifts all estimates in one direction.

    Args:
        curved: Curvature terms along each direction, (n, T, width), as returned by `Directions.derivative`.
    """
    return np.asarray(curved.sum(axis=0) / math.sqrt(2.0))


def _given(covariance: Array, rest: Sequence[int]) -> Array:
    """Conditional covariance of the numbers with the indices `rest`, (k, k), if all other numbers are known."""
    size = 1 / np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance * np.outer(size, size) + RIDGE * np.eye(len(size)))
    return np.asarray(np.linalg.inv(inverse[np.ix_(rest, rest)]) / np.outer(size[rest], size[rest]))
