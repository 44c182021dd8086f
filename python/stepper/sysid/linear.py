"""Derivatives over what is not known: differences as wide as a normal distribution, by which a kink counts as much as it is likely.

Where a contact begins, readings have kinks that are nearer to one another than what is known of the state. The slope at one point is then
that of one piece, and overstates what the readings determine. So the differences are those of the second-order divided-difference
filter (Norgaard, Poulsen and Ravn 2000): above and below the estimate along the columns of a root of the covariance, sqrt(3) standard
deviations long. Half their difference is the slope. Curvature shifts the mean of the readings, and what else it leaves counts as noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.residuals import slopes

LENGTH = math.sqrt(3.0)
"""Standard deviations that a difference reaches to either side: right to the fourth moment of a normal distribution."""


class Directions:
    """Directions along which differences are taken.

    Args:
        covariance: Of x, (n, n).
        local: Half widths of differences that are the narrowest, (n,).
        room: Distances from x to its bounds, of those that have some, the smaller one; infinite elsewhere, (n,).
        apart: Indices of x with local differences along their axes; the other directions are those of the covariance, these fixed.

    Attributes:
        columns: A direction in each column, (n, n).
    """

    def __init__(self, covariance: Array, local: Array, room: Array, apart: Sequence[int]):
        n = len(local)
        self._local, self._apart = local, list(apart)
        rest = [j for j in range(n) if j not in self._apart]
        self.columns = np.zeros((n, n))
        self.columns[self._apart, self._apart] = local[self._apart]
        if rest:
            self.columns[np.ix_(rest, rest)] = LENGTH * _root(_given(covariance, rest))
        for c in rest:
            column = self.columns[:, c]
            narrow = np.abs(column / local).max()
            wide = (np.abs(column) / np.maximum(room, local)).max()
            column *= (1.0 if narrow >= 1 else 1 / max(narrow, 1e-300)) / max(wide, 1.0)

    def points(self, x: Array) -> Array:
        """Points above and below x along each direction, (2 n, n)."""
        out = np.repeat(x[None], 2 * len(x), axis=0)
        out[::2] += self.columns.T
        out[1::2] -= self.columns.T
        return out

    def derivative(self, y: Array, spans: Array) -> tuple[Array, Array]:
        """Slopes after x, (n, T, width), and what curvature adds to them along each direction, (n, T, width).

        Args:
            y: Values at x, and at all of `points`, (1 + 2 n, T, width).
            spans: Widths of the local differences above and below, (n, 2).
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
    """Mean over what is not known minus the value at the estimate, (T, width), of what `Directions.derivative` returns as curvature.

    Exact for quadratic functions. Without it, a kink shifts every estimate to the same side.
    """
    return np.asarray(curved.sum(axis=0) / math.sqrt(2.0))


def _given(covariance: Array, rest: Sequence[int]) -> Array:
    """Covariance of some numbers where the others are held."""
    size = 1 / np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance * np.outer(size, size) + 1e-12 * np.eye(len(size)))
    return np.asarray(np.linalg.inv(inverse[np.ix_(rest, rest)]) / np.outer(size[rest], size[rest]))


def _root(covariance: Array) -> Array:
    """Lower root, of numbers of very different sizes."""
    std = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(std, std)
    return np.asarray(np.linalg.cholesky(correlation + 1e-12 * np.eye(len(std))) * std[:, None])
