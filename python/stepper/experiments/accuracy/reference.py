"""What is right: a run whose time steps are halved until it says how well it is known, by two methods.

The first method is the midpoint rule, at steps h, h/2, h/4 and so on; the second, at the finest of these steps, is Euler's rule, whose
errors are of another kind. Three runs give an observed order p = log2(|x(h) - x(h/2)| / |x(h/2) - x(h/4)|), and Richardson's estimate of
the error of the last, |x(h/2) - x(h/4)| / (2^p - 1), holds where the order is that of the rule in smooth motion. Across impacts, sticking
and sliding it is not: errors of single impacts add up with any sign, orders wander, and the estimate is then the difference of the last
two runs itself. Where the two methods differ by more than twice the second one's own difference of two steps, the rest is uncertainty
too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.experiments.accuracy.traces import Distance, Trace, run
from stepper.experiments.study.batches import steps_of
from stepper.experiments.study.points import USUAL
from stepper.experiments.study.study import Study

Array = NDArray[np.float64]
_HARD: dict[str, Any] = {"contact": "hard", "integrator": "midpoint"}
"""The law and the rule of the first method, whatever a study's own options are."""
TIGHT: dict[str, Any] = {"tolerance": 1e-11, "iterations": 1000, "precision": "f64"}
"""Settings with which the solver leaves next to nothing."""
_ROUNDING = 1e-11
"""m or rad below which differences of two runs are rounding and what the solver leaves."""
_SMOOTH = (1.6, 2.6)
"""Observed orders of the midpoint rule that are taken for those of smooth motion."""


@dataclass(frozen=True)
class Reference:
    """A run that is taken for right, and how well it is known.

    Attributes:
        runs: The three finest runs of the first method, the finest last.
        second: Runs of the second method at the two finest steps; none where it does not apply.
        target: Uncertainty that was asked for.
        uncertainty: Of every episode up to the horizon, in the unit of the distance: (episodes,).
        orders: Observed in every episode: (episodes,); NaN where a difference is rounding.
        extrapolates: Whether Richardson's estimate holds, of every episode: (episodes,).
        methods: Distance of the two methods, (episodes,); NaN with one method.
        known: Time up to which the last two runs of every episode differ by no more than the target, s: (episodes,).
    """

    runs: tuple[Trace, ...]
    second: tuple[Trace, ...]
    target: float
    uncertainty: Array
    orders: Array
    extrapolates: NDArray[np.bool_]
    methods: Array
    known: Array

    @property
    def trace(self) -> Trace:
        """The finest run."""
        return self.runs[-1]

    @property
    def timestep(self) -> float:
        """Of the finest run, s."""
        return self.trace.timestep

    def judged(self, distance: Distance) -> Reference:
        """The same runs by another distance, up to another horizon."""
        return _judged(self.runs, self.second, distance, self.target)

    @property
    def words(self) -> str:
        """What it is, in a sentence or two."""
        smooth, n = int(self.extrapolates.sum()), len(self.extrapolates)
        orders = self.orders[np.isfinite(self.orders)]
        told = [f"time steps halved to {1e6 * self.timestep:.4g} us", f"observed order {np.median(orders):.1f}" if len(orders) else ""]
        if smooth < n:
            told.append(
                f"no extrapolation in {n - smooth} of {n} episodes, whose orders are not those of smooth motion (impacts, sticking)"
            )
        if np.isfinite(self.methods).all():
            told.append(f"Euler's rule is {np.median(self.methods):.1e} away")
        told.append(f"uncertainty {np.median(self.uncertainty):.1e} (median), {self.uncertainty.max():.1e} (largest)")
        return "; ".join(part for part in told if part)


def check_moves(study: Study) -> Study:
    """The study; ValueError for a model without joints, whose error is nothing whatever the settings."""
    model = study.loaded[0]
    if model.nv == 0:
        raise ValueError(f"{model.name or study.name} has no joints, so that nothing moves: give it some, as <freejoint/> to what flies")
    return study


def converge(
    study: Study,
    episodes: Sequence[int],
    distance: Distance,
    *,
    target: float,
    most: int = 7,
    setting: str = USUAL,
    law: dict[str, Any] | None = None,
    tick: Callable[[float], None] | None = None,
) -> Reference:
    """Converges a run: halves the time step until every episode is known to a target, or often enough.

    Args:
        study: The study.
        episodes: Their numbers.
        distance: Of two runs.
        target: Uncertainty that is asked for, in the unit of the distance; it decides `Reference.known` too.
        most: Halvings of the study's time step at the most, at least 2.
        setting: Name of the settings.
        law: Settings in place of hard contact by the midpoint rule; MuJoCo's, say, which Euler's rule does not judge.
        tick: Called with the fraction done.
    """
    base = _HARD if law is None else law
    ours = base.get("engine") != "mujoco"
    tight = TIGHT if ours else {}
    finest = steps_of(study, run(study, episodes[:1], setting, **base).timestep)
    runs: list[Trace] = []
    for k in range(most + 1):
        runs = [*runs[-2:], run(study, episodes, setting, **(base | tight | {"timestep": study.hold / (finest * 2**k)}))]
        if tick:
            tick(2.0 ** (k - most))
        if len(runs) == 3 and _judged(runs, (), distance, target).uncertainty.max() <= target:
            break
    euler: list[Trace] = []
    if law is None:
        euler = [run(study, episodes, setting, **(base | TIGHT | {"integrator": "euler", "timestep": of.timestep})) for of in runs[1:]]
    if tick:
        tick(1.0)
    return _judged(runs, euler, distance, target)


def _judged(runs: Sequence[Trace], second: Sequence[Trace], distance: Distance, target: float) -> Reference:
    """How well the last of three runs is known."""
    one, two = distance(runs[0], runs[1]), distance(runs[1], runs[2])
    rounding = two <= _ROUNDING
    with np.errstate(divide="ignore", invalid="ignore"):
        orders = np.where(rounding | (one <= _ROUNDING), np.nan, np.log2(one / two))
        smooth = ((orders > _SMOOTH[0]) & (orders < _SMOOTH[1])) | rounding
        richardson = two / (2.0**orders - 1.0)
    own = np.where(rounding, _ROUNDING, np.where(smooth, richardson, two))
    methods = np.full(len(own), np.nan)
    if second:
        methods = distance(runs[-1], second[-1])
        # Of a rule of first order the last difference is the error; across impacts it can be twice that.
        with np.errstate(invalid="ignore"):
            own = np.maximum(own, methods - 2.0 * distance(second[0], second[1]))
        # Infinite less infinite: where the second method is not finite, nothing is known.
        own = np.where(np.isnan(own), np.inf, own)
    good = distance.over_time(runs[1], runs[2]) <= target
    until = np.concatenate([[0.0], runs[2].time])[np.where(good.all(axis=0), len(good), (~good).argmax(axis=0))]
    return Reference(tuple(runs), tuple(second), target, own, orders, smooth, methods, until)
