"""Warnings about an estimate: undetermined parameters, and readings that the model does not explain.

Standard deviations are in units of the parameters' scales (`Block.scale`), relative for positive quantities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import SIGNIFICANT, Point, cost_ratio
from stepper.sysid.parameters import Block, natural
from stepper.sysid.residuals import Residuals
from stepper.sysid.uncertainty import Uncertainty

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
    """Values at another minimum that is not significantly worse, (n,); NaN where they are within 5 standard deviations.

    Args:
        residuals: Residuals of the fit.
        found: Identification without warnings.
        std: Standard deviations of the values, (n,).
    """
    out = np.full(len(std), np.nan)
    best = min(search.cost for search in found.searches)
    for search in found.searches:
        values = natural(residuals.blocks, search.theta)
        if search.cost <= best * cost_ratio(residuals, SIGNIFICANT):
            out = np.where(np.abs(values - found.values) > 5 * std, values, out)
    return out
