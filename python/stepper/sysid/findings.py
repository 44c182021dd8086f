"""Warnings about an estimate: undetermined parameters, and readings that the model does not explain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.parameters import Block
from stepper.sysid.residuals import Residuals
from stepper.sysid.uncertainty import Uncertainty

UNKNOWN = 0.5
"""A parameter is not determined if its standard deviation is above this share of its bounds' half width."""
VAGUE = 0.7
"""Or, of a positive quantity, above this as a logarithm: 95 % of a factor of four up and down."""
TWINS = 0.98
"""Correlation beyond which two parameters are known together only,"""
LOOSE = 0.1
"""unless each is known to this share of its scale nevertheless."""
ROUGH = 0.3
"""Share by which slopes from one step and from twice that may differ."""


def undetermined(blocks: Sequence[Block], std: Array, reach: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mask of the numbers that the data do not determine, (n,); `std` and `reach` are those of x, (n,)."""
    logarithmic = np.concatenate([np.full(block.size, block.kind.log) for block in blocks])
    found: np.ndarray[Any, np.dtype[np.bool_]] = (std > UNKNOWN * reach) | (logarithmic & (std > VAGUE))
    return found


def warnings_of(
    residuals: Residuals,
    x: Array,
    sure: Uncertainty,
    *,
    reach: Array,
    roughness: Array,
    searches: Sequence[Any],
    converged: bool,
    weights: Array,
) -> tuple[str, ...]:
    """Warnings about an estimate x, (n,), in scales, the most serious first. `reach`, `roughness` and `weights` are of the same numbers."""
    blocks, simulator, n = residuals.blocks, residuals.simulator, residuals.n
    labels = [label for block in blocks for label in block.labels]
    hints = [block.hint for block in blocks for _ in block.labels]
    std = np.sqrt(np.diag(sure.covariance))
    open_ = undetermined(blocks, std, reach)
    out = []
    for j in range(n):
        if open_[j]:
            # Slopes that another step contradicts are rounding.
            idle = sure.effect[j] < 1e-3 or roughness[j] > 1
            why = "no reading depends on it" if idle else "the readings hardly depend on it, or as on others"
            out.append(f"{labels[j]} is not determined by these data, {why}: {hints[j]}")
    known: list[int] = [int(j) for j in np.flatnonzero(~open_)]
    correlation = sure.covariance / np.outer(std, std)
    for a, i in enumerate(known):
        for j in known[a + 1 :]:
            if abs(correlation[i, j]) > TWINS and max(std[i], std[j]) > LOOSE:
                how = "ratio" if correlation[i, j] > 0 else "product"
                out.append(
                    f"{labels[i]} and {labels[j]} are known together only (correlation {correlation[i, j]:.3f}, as of a {how}): {hints[j]}"
                )
    for j in known:
        at = "lower" if x[j] - residuals.low[j] < residuals.step else "upper" if residuals.high[j] - x[j] < residuals.step else ""
        if at:
            out.append(f"{labels[j]} is at its {at} bound: its interval ends there, and others may be wrong; widen it or look at the data")
        if roughness[j] > ROUGH:
            out.append(
                f"{labels[j]}: slopes from one step and from twice that differ by {100 * roughness[j]:.0f} %; contacts open or close "
                f"nearby, and the interval is rough: compare with step={residuals.step / 10:g}, or give shorter episodes"
            )
    if not converged:
        out.append("the search ran out of evaluations; raise max_evaluations")
    out += _fit_warnings(residuals, x, sure, searches=searches, labels=labels, known=np.array(known, int), weights=weights)
    if simulator.untrusted > 0.001:
        out.append(f"{100 * simulator.untrusted:.2g} % of the steps were not solved, or left contacts out; see Stepper.status")
    return (*out, *dict.fromkeys(note for episode in simulator.episodes for note in episode.notes))


def _fit_warnings(
    residuals: Residuals,
    x: Array,
    sure: Uncertainty,
    *,
    searches: Sequence[Any],
    labels: Sequence[str],
    known: np.ndarray[Any, Any],
    weights: Array,
) -> list[str]:
    """Findings from the residuals and the other searches."""
    out = []
    std = np.sqrt(np.diag(sure.covariance))
    best = min(s.cost for s in searches)
    count = residuals.count
    for search in searches:
        apart = np.abs(search.x[known] - x[known]) / np.maximum(std[known], 1e-12) if len(known) else np.zeros(0)
        # Equivalent to the best: the sum of squares differs by less than noise makes it, in units in which the best leaves one per reading.
        excess = 2 * (search.cost - best) * count / max(2 * best, 1e-300)
        if len(apart) and apart.max() > 5 and excess < 4:
            j = int(known[int(apart.argmax())])
            out.append(
                f"another answer fits as well, with {labels[j]} {apart.max():.0f} standard deviations away; more data can tell them apart"
            )
            break
    widest = float(sure.inflation[known].max()) if len(known) else 1.0
    if widest > 1.5:
        out.append(
            f"residuals are correlated in time or larger than the noise that was given: intervals are up to {widest:.1f} times as wide as "
            "those of white noise; the model may lack something"
        )
    if (lost := float(np.mean(weights < 0.1))) > 0.001:
        out.append(f"{100 * lost:.2g} % of the readings are outliers, which the loss heeds little")
    return out
