"""Start points of searches for other minima, which may explain the readings as well as an estimate.

Two masses of a pendulum can have the same first moment and moment of inertia, and two distances the same period. A body that turns freely
shows the square of its centre of mass. Two equal parts can change places. Two kinds of start points find different minima:

- Directions that the data determine worst are followed on both sides, along curved valleys. Where the sum of squared residuals falls again
  with the distance from the estimate, a search starts. This finds minima that few searches from elsewhere reach.
- A Sobol sequence around the estimate, with more points near it than far from it. This finds minima in directions that are not followed.

Valleys and searches use one-sided differences, which take about half the simulations of central ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import FLAT_STD
from stepper.sysid.residuals import Linearized, Residuals

SPREAD = 1.5
"""Largest change of a logarithm from the start values, or along a direction: a factor e^1.5 = 4.5."""
WIDER = 3.0
"""Ratio of the largest change of other numbers along a direction, in units of their scales, to that of logarithms."""
FARTHEST = 4.5
"""Largest change of a logarithm from the estimate in a Sobol sequence, a factor e^4.5 = 90. That of other numbers is 9 scales.

For inertias it is `SPREAD`: at `FARTHEST`, an identification of ten numbers made 2.5 times the steps.
Two springs with a ratio of 12 that can change places: at 1.5 without `TAIL`, 23 of 24 runs missed the other order, at 4.5, 1.
"""
TAIL = 1.5
"""Exponent of the distance from the estimate in a Sobol sequence, as a fraction of the largest distance. At 1.5, half are below 0.35."""
SPREAD_STARTS = 8
"""Number of start points of a Sobol sequence around the estimate.

Two springs that can change places: with four points, 4 of 48 runs missed the other order, with eight, 1.
"""
FOLLOWED = 2
"""Number of directions that are followed.

Three springs that can change places: with one direction, 4 of 24 runs missed other orders, with two, none.
"""
WEAKER = 0.5
"""Ratio of a direction's effect on the readings to the largest effect of one, above which only the weakest direction is followed."""
STRIDES = 4
"""Number of steps on each side of a direction, of `SPREAD / STRIDES` each. Twice as many find no other minima of the benchmark's scenes."""


def sobol(qmc: Any, residuals: Residuals, centre: Array, reach: Array, *, count: int, seed: int) -> Array:
    """Points of a Sobol sequence around a centre, within the bounds, (count, n + starts), in units of the scales.

    `count` must be a power of two.

    Args:
        qmc: Module `scipy.stats.qmc`.
        residuals: Residuals of the fit.
        centre: Centre, (n + starts,), in units of the scales: n parameters, then uncertain initial coordinates, which stay the same.
        reach: Largest distance of each parameter from the centre, in units of the scales, (n,).
        count: Number of points.
        seed: Seed of the sequence.
    """
    n = residuals.n
    low, high = np.maximum(residuals.low[:n], centre[:n] - reach), np.minimum(residuals.high[:n], centre[:n] + reach)
    points = np.tile(centre, (count, 1))
    points[:, :n] = low + qmc.Sobol(n, seed=seed).random(count) * (high - low)
    return points


def beyond(qmc: Any, residuals: Residuals, x: Array, at: Linearized, seed: int) -> list[Array]:
    """Start points of searches for minima other than the estimate x.

    Args:
        qmc: Module `scipy.stats.qmc`.
        residuals: Residuals of the fit.
        x: Estimate, (n + starts,), in units of the scales.
        at: Residuals and Jacobian at the estimate.
        seed: Seed of the Sobol sequence.
    """
    sizes = np.array([block.size for block in residuals.blocks])
    logarithmic = np.repeat([block.kind.log for block in residuals.blocks], sizes)
    reach = SPREAD * np.where(logarithmic, 1.0, WIDER)
    farthest = np.where(logarithmic, np.where(np.repeat(sizes, sizes) == 1, FARTHEST, SPREAD), 2 * FARTHEST)
    return [*_falling(residuals, x, at, reach), *_tailed(qmc, residuals, x, farthest, seed)]


def _tailed(qmc: Any, residuals: Residuals, x: Array, farthest: Array, seed: int) -> Array:
    """Points of a Sobol sequence around the estimate x, within the bounds, (SPREAD_STARTS, n + starts), more of them near than far."""
    n = residuals.n
    share = 2 * qmc.Sobol(n, seed=seed).random(SPREAD_STARTS) - 1
    room = np.where(share > 0, residuals.high[:n] - x[:n], x[:n] - residuals.low[:n])
    points = np.tile(x, (SPREAD_STARTS, 1))
    points[:, :n] += np.sign(share) * np.abs(share) ** TAIL * np.minimum(farthest, room)
    return points


@dataclass(frozen=True)
class _Walk:
    """Walk along a valley of the cost, away from the estimate.

    Attributes:
        x: Point of the valley, (n + starts,).
        ahead: Direction of the walk, (n + starts,), a unit vector.
        falls: Whether the cost falls in this direction.
    """

    x: Array
    ahead: Array
    falls: bool = False


def _falling(residuals: Residuals, x: Array, at: Linearized, reach: Array) -> Iterator[Array]:
    """Last points of valleys, within `reach` of the estimate x, at which the cost falls with the distance from the estimate."""
    _, S, Vt = np.linalg.svd(at.jacobian[:, : residuals.n], full_matrices=False)
    known = S > 1 / FLAT_STD
    weak = [k for k in np.flatnonzero(known)[-FOLLOWED:] if WEAKER * S[0] > S[k] or k == known.sum() - 1]
    axes = np.pad(Vt[weak], ((0, 0), (0, len(x) - residuals.n)))
    walks = [_Walk(x, sign * axis) for axis in axes for sign in (-1.0, 1.0)]
    for _ in range(STRIDES):
        points = [_ahead(residuals, walk, reach / STRIDES) for walk in walks]
        going = [k for k, walk in enumerate(walks) if np.abs(points[k] - walk.x).max() > residuals.step]
        after = dict(zip(going, residuals.linearize([points[k] for k in going], sides=1), strict=True)) if going else {}
        onward = []
        for k, walk in enumerate(walks):
            there = _walked(walk, points[k], after[k], reach / STRIDES) if k in after else None
            if walk.falls and not (there and there.falls):
                yield walk.x
            onward += [there] if there else []
        walks = onward
    yield from (walk.x for walk in walks if walk.falls)


def _ahead(residuals: Residuals, walk: _Walk, stride: Array) -> Array:
    """Point that is a stride ahead of a walk, within the bounds. `stride` is the largest change of each parameter, (n,)."""
    largest = float(np.abs(walk.ahead[: len(stride)] / stride).max())
    return np.clip(walk.x + walk.ahead / largest, residuals.low, residuals.high)


def _walked(walk: _Walk, point: Array, at: Linearized, stride: Array) -> _Walk | None:
    """Walk after a step to a point and a Gauss-Newton step across its direction into the valley; None where the simulation fails.

    `stride` is the largest change of each parameter in a step, (n,). The Gauss-Newton step is at most twice as long.
    """
    if not np.isfinite(at.residual).all() or not np.isfinite(at.jacobian).all():
        return None
    along = at.jacobian @ walk.ahead
    U, S, Vt = np.linalg.svd(at.jacobian - np.outer(along, walk.ahead), full_matrices=False)
    sure = S > 1 / FLAT_STD
    across = -(Vt[sure].T / S[sure]) @ (U[:, sure].T @ at.residual)
    across *= min(1.0, 2 / max(float(np.abs(across[: len(stride)] / stride).max()), 1e-300))
    moved = point + across - walk.x
    falls = bool((at.residual + at.jacobian @ across) @ along < 0)
    return _Walk(point + across, moved / np.linalg.norm(moved), falls)
