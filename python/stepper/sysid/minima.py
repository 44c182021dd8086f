"""Start points of least-squares searches, for an estimate and for other minima that may explain the readings as well.

Two masses of a pendulum can have the same first moment and moment of inertia, and two distances the same period. A body that turns freely
shows the square of its centre of mass. Two equal parts can change places. Some minima attract only searches from a small region. A search
finds the second mass of a pendulum only if it starts at a larger mass with the centre near the joint.

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
NEAR = 1.5
"""Largest change of all numbers in first searches, and of logarithms of a parameter that has several.

At `FARTHEST`, an identification of ten numbers made 2.5 times the steps, and first searches of a held box 1.7 times the evaluations.
"""
DRAWN = 8
"""Least number of points of the Sobol sequence per search. Twice as many found no more minima of pendulums, springs and balls."""
FIRST_PART = 0.5
"""Part of the time of each episode that is simulated at these points.

Of 276 runs of pendulums, springs and balls with two minima, 2 missed one of them. With a quarter of the time, 5 did.
"""
APART = 1.0
"""Distance in units of the scales at which a chosen point doubles the sum of squares of another point.

With 3, 5 of 120 runs of pendulums missed a minimum; with 1, 2 did. Without the increase, 8 of 24 runs of balls did.
"""


def starts_around(qmc: Any, residuals: Residuals, x: Array, count: int, seed: int, *, first: bool = False) -> list[Array]:
    """Start points of `count` searches around a point x, but far from it and from each other, (n + starts,) each.

    Args:
        qmc: Module `scipy.stats.qmc`.
        residuals: Residuals of the fit.
        x: Estimate or start values, (n + starts,), in units of the scales.
        count: Number of start points.
        seed: Seed of the Sobol sequence.
        first: Whether these are the first searches: they start nearer to x, and may start at similar points.
    """
    if not count:
        return []
    # A Sobol sequence is balanced if the number of its points is a power of two.
    drawn = 1 << int(np.ceil(np.log2(DRAWN * count)))
    points, part = _drawn(qmc, residuals, x, seed, count=drawn, first=first), residuals.first_part(FIRST_PART)
    costs = np.nan_to_num((part.residuals(points) ** 2).sum(axis=1), nan=np.inf)
    residuals.simulator.steps += part.simulator.steps
    apart = APART / 10 if first else APART
    out = [x]
    for _ in range(min(count, np.isfinite(costs).sum())):
        costs = costs * (1 + apart**2 / np.maximum(((points - out[-1]) ** 2).sum(axis=1), 1e-12))
        best = costs.argmin()
        out.append(points[best])
        costs[best] = np.inf
    return out[1:]


def _drawn(qmc: Any, residuals: Residuals, x: Array, seed: int, *, count: int, first: bool) -> Array:
    """Points of a Sobol sequence around a point x, within the bounds, (count, n + starts).

    Vectors such as a centre of mass are drawn around that of x, and then multiplied by a factor between 1/90 and 1, because
    lengths have no natural scale. Those of the `first` searches are not shrunk.
    """
    points, begin = np.tile(x, (count, 1)), 0
    drawn = qmc.Sobol(residuals.n + len(residuals.blocks), seed=seed).random(count)
    for k, block in enumerate(residuals.blocks):
        own = slice(begin, begin + block.size)
        begin += block.size
        vector = block.size > 1 and not block.kind.log
        reach = NEAR if first or (block.size > 1 and block.kind.log) else FARTHEST if block.kind.log else 2 * FARTHEST
        low, high = np.maximum(residuals.low[own], x[own] - reach), np.minimum(residuals.high[own], x[own] + reach)
        points[:, own] = low + drawn[:, own] * (high - low)
        if vector and not first:
            points[:, own] *= np.exp(-FARTHEST * drawn[:, [residuals.n + k]])
    return np.asarray(np.clip(points, residuals.low, residuals.high))
