"""Fit of parameters to a rough loss, by the cross-entropy method.

The loss of a simulated motion with impacts jumps between neighbouring values: a body whose corner hits the floor a little earlier tumbles
to another place. Gradients and the single best sample follow such jumps. The cross-entropy method (R. Y. Rubinstein, "The cross-entropy
method for combinatorial and continuous optimization", Methodology and Computing in Applied Probability 1, 1999) fits a normal distribution
to the best samples of a round, and draws the next round from it. The result is the mean of the last elite, not the best sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepper.shared.machine import require

Array = NDArray[np.float64]
Loss = Callable[[Array], Array]
"""Function of parameter values, (samples, parameters), that returns the loss of each sample, (samples,)."""
_SMOOTHING = 0.7
"""Weight of a round's mean and deviation in the average with the last round, so that a lucky round cannot end the search."""
_START_SPREAD = 0.15
"""Standard deviation of the first round around given values, as a fraction of the bounds."""


@dataclass(frozen=True)
class Fit:
    """Fitted values.

    Attributes:
        values: Fitted value of each parameter, (parameters,).
        spread: Standard deviation of each parameter over the last elite, (parameters,). The loss does not distinguish values within it.
        loss: Loss at `values`.
        evaluations: Number of evaluations of the loss.
    """

    values: Array
    spread: Array
    loss: float
    evaluations: int


def fit(
    loss: Loss, low: Array, high: Array, *, samples: int = 20, elite: int = 6, rounds: int = 6, seed: int = 0, start: Array | None = None
) -> Fit:
    """Minimises a rough loss within bounds, and returns the fitted values.

    Args:
        loss: The loss. Samples whose loss is not finite are never in the elite.
        low: Lower bounds, (parameters,), in the units of the parameters.
        high: Upper bounds, (parameters,), in the units of the parameters.
        samples: Number of samples per round. The first round, a Sobol sequence over the bounds, has twice as many.
        elite: Number of best samples of a round to which the distribution is fitted.
        rounds: Number of rounds.
        seed: Seed of the samples.
        start: Values that fit well, such as those of a fit of fewer parameters, (parameters,), in the units of the parameters. The first
            round is drawn around them, and they are the result unless the search finds a smaller loss.
    """
    low, high = np.asarray(low, float), np.asarray(high, float)
    rng = np.random.default_rng([seed, 0])
    sobol = require("scipy.stats", "to fit parameters").qmc.Sobol(len(low), rng=rng)
    unit = sobol.random_base2(int(np.ceil(np.log2(2 * samples))))[: 2 * samples]
    mean, spread, count = np.full(len(low), 0.5), np.full(len(low), 0.3), 0
    if start is not None:
        mean, spread = (np.asarray(start, float) - low) / (high - low), np.full(len(low), _START_SPREAD)
    for number in range(rounds):
        if number or start is not None:
            unit = np.clip(mean + spread * rng.standard_normal((samples, len(low))), 0.0, 1.0)
        losses = np.asarray(loss(low + unit * (high - low)), float)
        count += len(losses)
        order = np.argsort(np.where(np.isfinite(losses), losses, np.inf), kind="stable")[: max(2, elite)]
        if not np.isfinite(losses[order[:2]]).all():
            raise ValueError(f"round {number + 1} of the fit has fewer than two samples with a finite loss: narrow the bounds")
        best = unit[order[np.isfinite(losses[order])]]
        weight = _SMOOTHING if number or start is not None else 1.0
        mean = weight * best.mean(axis=0) + (1.0 - weight) * mean
        spread = weight * best.std(axis=0, ddof=1) + (1.0 - weight) * spread
    ends = [low + mean * (high - low)] + ([] if start is None else [np.asarray(start, float)])
    losses = np.asarray(loss(np.array(ends)), float)
    least = int(np.argmin(np.where(np.isfinite(losses), losses, np.inf)))
    return Fit(ends[least], spread * (high - low), float(losses[least]), count + len(ends))


def bootstrap(values: Array, statistic: Callable[..., Array] = np.mean, *, resamples: int = 2000, seed: int = 0) -> tuple[float, float]:
    """95 % percentile bootstrap interval of a statistic of independent values, (n,) (B. Efron, Annals of Statistics 7, 1979).

    `statistic` is a function of an array and `axis`, such as `numpy.mean`.
    """
    rng = np.random.default_rng([seed, 1])
    values = np.asarray(values, float)
    drawn = statistic(values[rng.integers(len(values), size=(resamples, len(values)))], axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)
