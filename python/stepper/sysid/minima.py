"""Start points of least-squares searches, for an estimate and for other minima that may explain the readings as well.

Two masses of a pendulum can have the same first moment and moment of inertia, and two distances the same period. A body that turns freely
shows the square of its centre of mass. Two equal parts can change places. Some minima attract only searches from a small region. The second
mass of a pendulum attracts those from large masses with a centre near the joint.

Therefore many points of a Sobol sequence are simulated for the first part of the time, in which trajectories have hardly diverged. Searches
start at points with a small sum of squares that are far from the estimate and from each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.residuals import Residuals

FARTHEST = 4.5
"""Largest change of a logarithm from the centre of the points, a factor e^4.5 = 90. That of other numbers is 9 scales."""
FARTHEST_OF_SEVERAL = 1.5
"""Largest change of each logarithm of a parameter that has several.

At `FARTHEST`, an identification of ten numbers made 2.5 times the steps.
"""
DRAWN = 128
"""Number of points of the Sobol sequence, a power of two. Twice as many found no more minima of pendulums, springs and balls."""
FIRST_PART = 0.5
"""Part of the time of each episode that is simulated at these points.

Of 276 runs of pendulums, springs and balls with two minima, 2 missed one of them. With a quarter of the time, 5 did.
"""
APART = 1.0
"""Distance in units of the scales within which a chosen point increases the sum of squares of other points.

At 3, 5 of 120 runs of pendulums missed a minimum, at 1, 2. Without the increase, 8 of 24 runs of balls did.
"""


def starts_around(qmc: Any, residuals: Residuals, x: Array, count: int, seed: int) -> list[Array]:
    """Start points of `count` searches around a point x, but far from it and from each other, (n + starts,) each.

    Args:
        qmc: Module `scipy.stats.qmc`.
        residuals: Residuals of the fit.
        x: Estimate or start values, (n + starts,), in units of the scales.
        count: Number of start points.
        seed: Seed of the Sobol sequence.
    """
    if not count:
        return []
    points, first = _drawn(qmc, residuals, x, seed), residuals.first_part(FIRST_PART)
    costs = np.nan_to_num((first.residuals(points) ** 2).sum(axis=1), nan=np.inf)
    residuals.simulator.steps += first.simulator.steps
    out = [x]
    for _ in range(count):
        costs = costs * (1 + APART**2 / np.maximum(((points - out[-1]) ** 2).sum(axis=1), 1e-12))
        out.append(points[costs.argmin()])
    return out[1:]


def _drawn(qmc: Any, residuals: Residuals, x: Array, seed: int) -> Array:
    """Points of a Sobol sequence around a point x, within the bounds, (DRAWN, n + starts).

    Vectors such as a centre of mass are drawn around that of x, and then shrunk by a factor of up to 90: lengths have no natural scale.
    """
    points, first = np.tile(x, (DRAWN, 1)), 0
    drawn = qmc.Sobol(residuals.n + len(residuals.blocks), seed=seed).random(DRAWN)
    for k, block in enumerate(residuals.blocks):
        own = slice(first, first + block.size)
        first += block.size
        reach = 2 * FARTHEST if not block.kind.log else FARTHEST if block.size == 1 else FARTHEST_OF_SEVERAL
        low, high = np.maximum(residuals.low[own], x[own] - reach), np.minimum(residuals.high[own], x[own] + reach)
        points[:, own] = low + drawn[:, own] * (high - low)
        if block.size > 1 and not block.kind.log:
            points[:, own] *= np.exp(-FARTHEST * drawn[:, [residuals.n + k]])
    return np.asarray(np.clip(points, residuals.low, residuals.high))
