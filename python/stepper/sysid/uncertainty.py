"""Uncertainty of an estimate: covariance of the parameters for noise that may be correlated in time, and warnings.

At the estimate, the sum over time of the scores s_t = J_t^T r_t is zero. Here r_t are the residuals at time t in units of the noise, and
J_t is their Jacobian. The covariance of the estimate is the sandwich H^-1 S H^-1. S is the covariance of the sum of scores, and H = J^T J.

White noise has S = H; correlated noise (coloured sensors, model errors) has a larger S. S is estimated in two ways, and the larger estimate
is used:

- S = sum_c J_c^T Gamma_c J_c, where Gamma_c is the autocovariance of column c of the readings. Gamma_c comes from an autoregression of the
  residuals, of Akaike's order (Den Haan and Levin 1997), corrected for its bias in short series (Kendall 1954). A hundred samples
  suffice, because only the noise is estimated and the Jacobian is known.
- S = the long-run covariance of the scores, with Bartlett's kernel (Newey and West 1987) after first-order whitening (Andrews and Monahan
  1992). It needs more data, and detects residuals that are large where the Jacobian is large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper.shared.machine import require
from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import SIGNIFICANT, Point, cost_ratio
from stepper.sysid.parameters import Block, natural
from stepper.sysid.residuals import Residuals

LARGEST_AUTOCORRELATION = 0.97
"""Upper bound of an estimated first-order autocorrelation of residuals, as Andrews and Monahan advise."""
LONGEST_MEMORY = 10
"""Highest order of an autoregression of residuals."""
ROWS_PER_ORDER = 10
"""Number of residuals that each order of the autoregression requires."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the estimated parameters x, which are n numbers in units of their scales.

    Attributes:
        covariance: Covariance of x, (n, n). It is finite, because the bounds limit the variance of undetermined parameters.
        inflation: Ratios of the standard deviations to those for white noise, (n,).
    """

    covariance: Array
    inflation: Array


def uncertainty(J: Array, r: Array, times: np.ndarray[Any, np.dtype[np.int64]], reach: Array) -> Uncertainty:
    """Uncertainty of the n parameters, which are the first n columns of a Jacobian.

    Args:
        J: Jacobian of the residuals, (m, n + others). Columns beyond n (initial states) are eliminated.
        r: Residuals, (m,): readings first, then priors.
        times: Indices of the episode, control period and column of each of the k readings, (k, 3).
        reach: Half widths of the bounds, (n,), which are the standard deviations of undetermined parameters.
    """
    n = len(reach)
    k = len(times)
    if J.shape[1] > n:
        own, other = J[:, :n], J[:, n:]
        coupling = np.linalg.lstsq(other, own, rcond=None)[0]
        J = own - other @ coupling
    known = (J[k:]).T @ J[k:] + np.diag(reach**-2.0)
    scores = _by_time(r[:k, None] * J[:k], times)
    white = sum((s.T @ s for s in scores), np.zeros((n, n)))
    inverse = np.linalg.inv(J.T @ J + np.diag(reach**-2.0))
    plain = inverse @ (white + known) @ inverse
    # The larger of two noise levels counts: the given one, and that of the residuals.
    plain = _at_least(np.asarray(plain), np.asarray(inverse))
    coloured = _coloured(r[:k], J[:k], times)
    covariance = _at_least(np.asarray(inverse @ (coloured + known) @ inverse), plain)
    covariance = _at_least(covariance, np.asarray(inverse @ (_long_run(scores) + known) @ inverse))
    inflation = np.sqrt(np.diag(covariance) / np.diag(inverse))
    return Uncertainty((covariance + covariance.T) / 2, inflation)


def outside_null_space(J: Array, r: Array, times: np.ndarray[Any, np.dtype[np.int64]], reach: Array, null: Array) -> Uncertainty:
    """Uncertainty in which the bounds determine the covariance along a null space, and the data determine it in all other directions.

    Args:
        J: Jacobian of the residuals, (m, k), as for `uncertainty`, in SI units.
        r: Residuals, (m,), no unit.
        times: Indices of the readings, (m,), no unit.
        reach: Half widths of the bounds, (n,), in the units of the parameters.
        null: Orthonormal basis of the null space of the parameters, (n, q), no unit.
    """
    n, q = null.shape
    if not q:
        return uncertainty(J, r, times, reach)
    basis = np.linalg.svd(null)[0]
    along, across = basis[:, :q], basis[:, q:]
    within = np.concatenate([J[:, :n] @ across, J[:, n:]], axis=1)
    known = uncertainty(within, r, times, (across.T**2 @ reach**-2.0) ** -0.5)
    covariance = across @ known.covariance @ across.T + along @ np.linalg.inv((along.T * reach**-2.0) @ along) @ along.T
    return Uncertainty(covariance, known.inflation)


def _at_least(covariance: Array, other: Array) -> Array:
    """Copy of a covariance (n, n), scaled up so that no standard deviation is smaller than in the covariance `other`.

    Correlations do not change.
    """
    grow = np.sqrt(np.maximum(1.0, np.diag(other) / np.diag(covariance)))
    return np.asarray(grow[:, None] * covariance * grow)


def _by_time(rows: Array, times: np.ndarray[Any, np.dtype[np.int64]]) -> list[Array]:
    """Sums of the rows, (k, n), of readings with the same episode and time (see `_coloured`): one array (times, n) per episode."""
    places = _places(times)
    out = []
    for e in np.unique(times[:, 0]):
        mine = times[:, 0] == e
        summed = np.zeros((int(places[mine].max()) + 1, rows.shape[1]))
        np.add.at(summed, places[mine], rows[mine])
        out.append(summed)
    return out


def _places(times: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Time of each reading since the first of its episode, (k,), in sampling intervals; `times` as in `_coloured`."""
    _, episode = np.unique(times[:, 0], return_inverse=True)
    first = np.full(int(episode.max()) + 1, np.iinfo(np.int64).max)
    np.minimum.at(first, episode, times[:, 1])
    rows = times[:, 1] - first[episode]
    return np.asarray(rows // max(1, int(np.gcd.reduce(rows))))


def _coloured(r: Array, J: Array, times: np.ndarray[Any, np.dtype[np.int64]]) -> Array:
    """Covariance of J^T r, (n, n), for residuals r that are correlated in time: stationary in each column, independent between columns.

    Args:
        r: Residuals of the readings, (k,).
        J: Their Jacobian, (k, n).
        times: Indices of the episode, control period and column of each reading, (k, 3).
    """
    toeplitz = require("scipy.linalg", "to identify parameters").matmul_toeplitz
    S = np.zeros((J.shape[1],) * 2)
    for column in np.unique(times[:, 2]):
        series = []
        of_column = np.flatnonzero(times[:, 2] == column)
        places = _places(times[of_column])
        for episode in np.unique(times[of_column, 0]):
            own = times[of_column, 0] == episode
            mine, rows = of_column[own], places[own]
            # Rows without a measurement are zero in both arrays, and add nothing.
            whole, slope = np.zeros(rows.max() + 1), np.zeros((rows.max() + 1, J.shape[1]))
            whole[rows], slope[rows] = r[mine], J[mine]
            series.append((whole, slope))
        gamma = _autocovariance([whole for whole, _ in series], len(of_column))
        for _, slope in series:
            S += slope.T @ toeplitz(gamma[: len(slope)], slope)
    return S


def _autocovariance(series: list[Array], count: int) -> Array:
    """Autocovariance at all lags of the residuals of one column, from an autoregression.

    `series` has the residuals by episode, 0 where not measured, `count` is the number of those measured.
    """
    solve = require("scipy.linalg", "to identify parameters").solve_toeplitz
    longest = max(map(len, series))
    most = min(LONGEST_MEMORY, count // ROWS_PER_ORDER, longest - 1)
    lags = np.array([sum(float(x[lag:] @ x[: len(x) - lag]) for x in series if len(x) > lag) for lag in range(most + 1)]) / count
    if not lags[0] > 0:
        return np.zeros(longest)
    fits = [(np.zeros(0), float(lags[0]))]
    for order in range(1, most + 1):
        a = solve(lags[:order], lags[1 : order + 1])
        fits.append((a, float(lags[0] - a @ lags[1 : order + 1])))
    a, left = min(fits, key=lambda fit: count * np.log(max(fit[1], 1e-12 * lags[0])) + 2 * len(fit[0]))
    left *= count / max(count - len(a) - 1, 1)
    rho = float(a.sum())
    if rho > 0:
        # The estimate of rho is biased by -(1 + 3 rho) / count.
        larger = a * min(rho + (1 + 3 * rho) / count, max(rho, LARGEST_AUTOCORRELATION)) / rho
        a = larger if np.abs(np.roots([1.0, *-larger])).max() < 1 else a
    # Autocovariance from the spectrum, sampled finely enough that it does not alias.
    size = 1 << int(np.ceil(np.log2(8 * longest + 1024)))
    gamma = np.fft.irfft(left / np.abs(np.fft.rfft([1.0, *-a], size)) ** 2, size)
    return np.asarray(gamma[:longest])


def _long_run(scores: list[Array]) -> Array:
    """Covariance of the sum of the scores of all episodes, (n, n), for scores (times, n) that are correlated in time.

    The score of a time is the sum of its readings' residuals times their Jacobian, a vector (n,) for n parameters.
    """
    n = scores[0].shape[1]
    before = sum((s[:-1] ** 2).sum(axis=0) for s in scores)
    rho = sum((s[1:] * s[:-1]).sum(axis=0) for s in scores) / np.where(before > 0, before, 1.0)
    rho = np.clip(rho, 0.0, LARGEST_AUTOCORRELATION)
    # The first score of an episode has no predecessor, and is scaled to the variance of the others.
    whitened = [np.concatenate([s[:1] * np.sqrt(1 - rho**2), s[1:] - rho * s[:-1]]) for s in scores]
    longest = max(map(len, scores))
    lags = min(int(4 * (longest / 100) ** (2 / 9)), longest - 1)
    S = np.zeros((n, n))
    for u in whitened:
        S += u.T @ u
        for lag in range(1, min(lags, len(u) - 1) + 1):
            C = u[lag:].T @ u[:-lag]
            S += (1 - lag / (lags + 1)) * (C + C.T)
    colour = 1 / (1 - rho)
    return np.asarray(colour[:, None] * S * colour)


RIDGE = 1e-12
"""Relative increase of variances, so that a covariance that is singular to rounding has a root."""


def root_of(covariance: Array, ridge: float = 0.0) -> Array:
    """Lower-triangular (Cholesky) root of a covariance, or of several.

    Args:
        covariance: Covariance, (..., n, n), in squared units of its numbers, which may differ by many orders of magnitude.
        ridge: Relative increase of the variances.

    Returns:
        Root L with L L^T = covariance, (..., n, n).
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (std[..., :, None] * std[..., None, :])
    return np.asarray(np.linalg.cholesky(correlation + ridge * np.eye(std.shape[-1])) * std[..., :, None])


UNKNOWN = 0.5
"""Standard deviation of a parameter, divided by half the width of its bounds, above which the data do not determine the parameter."""
VAGUE = 0.7
"""Standard deviation of the logarithm of a positive parameter above which the parameter is not determined.

Its 95 % interval then spans a factor of four up and down.
"""
TWINS = 0.98
"""Correlation of two parameters above which the data determine only a combination of them, such as their ratio. See also `LOOSE`."""
LOOSE = 0.1
"""Standard deviation, in units of a parameter's scale, above which a high correlation of two parameters is reported.

One of the two parameters must have a larger standard deviation than this.
"""
ROUGH = 0.3
"""Relative difference between derivatives with a finite-difference step and with twice that step, above which a warning is given."""


def undetermined(blocks: Sequence[Block], std: Array, reach: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mask (n,) of the parameters that the data do not determine.

    Args:
        blocks: Parameters, n numbers in total.
        std: Standard deviations, in units of the parameters' scales, (n,).
        reach: Half widths of the bounds, in units of the scales, (n,).
    """
    logarithmic = np.concatenate([np.full(block.size, block.kind.log) for block in blocks])
    found: np.ndarray[Any, np.dtype[np.bool_]] = (std > UNKNOWN * reach) | (logarithmic & (std > VAGUE))
    return found


def warnings_of(residuals: Residuals, found: Any, sure: Uncertainty, *, slopes: Array, first: Point, converged: bool) -> tuple[str, ...]:
    """Warnings about an estimate, the most serious first.

    Args:
        residuals: Residuals of the fit.
        found: Identification without warnings.
        sure: Uncertainty of the estimate.
        slopes: Derivatives of the values with respect to the parameters in units of their scales, (n, n).
        first: Estimate, with the effect of each parameter on the readings and the roughness of this effect.
        converged: Whether the best search converged.
    """
    blocks, simulator = residuals.blocks, residuals.simulator
    labels, known = found.labels, [int(j) for j in np.flatnonzero(found.determined)]
    hints = [block.hint for block in blocks for _ in block.labels]
    out = []
    # Derivatives that change completely with the finite-difference step are rounding errors.
    idle = np.abs(slopes) @ ((first.effect >= 1e-3) & (first.roughness <= 1)) == 0
    covariance = slopes @ (found.covariance / np.outer(found.scale, found.scale)) @ slopes.T
    std = np.sqrt(np.diag(covariance))
    others = _other_values(residuals, found, std)
    for j in map(int, np.flatnonzero(~found.determined)):
        why = "no reading depends on it" if idle[j] else "the readings hardly depend on it, or depend on it as on other parameters"
        if not idle[j] and not np.isnan(others[j]):
            why = f"another estimate, with {others[j]:.4g}, fits equally well"
        out.append(f"{labels[j]} is not determined by these data, {why}: {hints[j]}")
    correlation = covariance / np.outer(std, std)
    relative = std / np.linalg.norm(slopes, axis=1)
    for a, i in enumerate(known):
        for j in known[a + 1 :]:
            if abs(correlation[i, j]) > TWINS and max(relative[i], relative[j]) > LOOSE:
                how = "ratio" if correlation[i, j] > 0 else "product"
                out.append(
                    f"{labels[i]} and {labels[j]} are known only together (correlation {correlation[i, j]:.3f}, as for a {how}): {hints[j]}"
                )
    x = found.theta / found.scale
    for j in known:
        at = "lower" if x[j] - residuals.low[j] < residuals.step else "upper" if residuals.high[j] - x[j] < residuals.step else ""
        if at:
            out.append(
                f"{labels[j]} is at its {at} bound: its interval ends there, and other estimates may be wrong; "
                "widen the bound or check the data"
            )
        if first.roughness[j] > ROUGH:
            out.append(
                f"{labels[j]}: finite differences with the step and with twice the step differ by {100 * first.roughness[j]:.0f} %, "
                f"because contacts open or close nearby. The interval is rough: compare with step={residuals.step / 10:g}, or give shorter "
                "episodes"
            )
    if not converged:
        out.append("the search ran out of evaluations; raise max_evaluations")
    if found.determined.any() and (widest := float(sure.inflation.max())) > 1.5:
        out.append(
            f"residuals are correlated in time or larger than the noise that was given: intervals are up to {widest:.1f} times as wide as "
            "those of white noise; the model may lack something"
        )
    if simulator.untrusted > 0.001:
        out.append(f"{100 * simulator.untrusted:.2g} % of the steps were not solved, or left contacts out; see Stepper.status")
    return (*out, *dict.fromkeys(note for episode in simulator.episodes for note in episode.notes))


def _other_values(residuals: Residuals, found: Any, std: Array) -> Array:
    """Values at another minimum that is not significantly worse, (n,); NaN where they are within 5 standard deviations."""
    out = np.full(len(std), np.nan)
    best = min(search.cost for search in found.searches)
    for search in found.searches:
        values = natural(residuals.blocks, search.theta)
        if search.cost <= best * cost_ratio(residuals, SIGNIFICANT):
            out = np.where(np.abs(values - found.values) > 5 * std, values, out)
    return out
