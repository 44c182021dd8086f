"""What is right: a run whose time steps are halved until it says how well it is known, by two methods.

The first method is the midpoint rule, at steps h, h/2, h/4 and so on; the second, at the finest of these steps, is Euler's rule, whose
errors are of another kind. Three runs give an observed order p = log2(|x(h) - x(h/2)| / |x(h/2) - x(h/4)|), and Richardson's estimate of
the error of the last, |x(h/2) - x(h/4)| / (2^p - 1), holds where the order is that of the rule in smooth motion. Across impacts, sticking
and sliding it is not: errors of single impacts add up with any sign, orders wander, and the estimate is then the difference of the last
two runs itself. Where the two methods differ by more than twice the second one's own difference of two steps, the rest is uncertainty
too. Euler's rule diverges with stiff damping of light links: then the implicit rule, whose errors are of first order too, is the second
method.

A clock may end it: with fewer halvings, without the second method, or with runs that got through the beginning of the episodes alone. What
is known is then known less well, or not as far, and the words say so.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.accuracy.budget import Stage
from stepper.lab.accuracy.traces import Distance, Trace, run
from stepper.lab.study.batches import steps_of
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study

Array = NDArray[np.float64]
_HARD: dict[str, Any] = {"contact": "hard", "integrator": "midpoint"}
"""The law and the rule of the first method, whatever a study's own options are."""
TIGHT: dict[str, Any] = {"tolerance": 1e-9, "iterations": 200, "precision": "f64"}
"""Settings with which the solver leaves next to nothing. Rounding of a humanoid's contacts is some 1e-11 m/s: what asks for that sweeps to
the end in most steps, and takes twenty times as long."""
_SECOND = {"euler": "Euler's rule", "implicit": "the implicit rule"}
"""Rules of the second method: the first one that stays finite and ends in time counts."""
_LEAST, _LOOK = 2.0, 1e-4
"""Seconds that a run may always take, and those of a step for looking at the clock."""
_SLOWER = 3.0
"""How many times as long as the first method the second one may take."""
_SHARE = 0.4
"""Share of what is left of the clock that one run of a reference may take."""
_ROUNDING = 1e-11
"""m or rad below which differences of two runs are rounding and what the solver leaves."""
_SMOOTH = (1.6, 2.6)
"""Observed orders of the midpoint rule that are taken for those of smooth motion."""


@dataclass(frozen=True)
class Reference:
    """A run that is taken for right, and how well it is known.

    Attributes:
        runs: The three finest runs of the first method, the finest last; two, or one of which nothing is known, where the clock ended it.
        second: Runs of the second method at the two finest steps; none where it does not apply.
        target: Uncertainty that was asked for.
        uncertainty: Of every episode up to the horizon, in the unit of the distance: (episodes,).
        orders: Observed in every episode: (episodes,); NaN where a difference is rounding.
        extrapolates: Whether Richardson's estimate holds, of every episode: (episodes,).
        methods: Distance of the two methods, (episodes,); NaN with one method.
        known: Time up to which the last two runs of every episode differ by no more than the target, s: (episodes,).
        stopped: Whether the clock ended it, and not the target.
        rule: Of the second method, in words.
        without: Rules that could not be the second method, since they diverge or take too long.
        exact: Name of the closed form that the only run is of; none of a run that is converged.
    """

    runs: tuple[Trace, ...]
    second: tuple[Trace, ...]
    target: float
    uncertainty: Array
    orders: Array
    extrapolates: NDArray[np.bool_]
    methods: Array
    known: Array
    stopped: bool = False
    rule: str = _SECOND["euler"]
    without: tuple[str, ...] = ()
    exact: str = ""

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
        if self.exact:
            return self
        found = _judged(self.runs, self.second, distance, self.target)
        return replace(found, stopped=self.stopped, rule=self.rule, without=self.without)

    @property
    def words(self) -> str:
        """What it is, in a sentence or two."""
        if self.exact:
            return f"the closed form {self.exact}"
        smooth, n = int(self.extrapolates.sum()), len(self.extrapolates)
        orders = self.orders[np.isfinite(self.orders)]
        told = [f"time steps halved to {1e6 * self.timestep:.4g} us", f"observed order {np.median(orders):.1f}" if len(orders) else ""]
        if self.stopped:
            told.append(f"no further, as the clock stopped it at {self.trace.reached:.3g} s of simulated time")
        if len(self.runs) == 1:
            told.append("a single run, of which nothing is known")
        if smooth < n:
            told.append(
                f"no extrapolation in {n - smooth} of {n} episodes, whose orders are not those of smooth motion (impacts, sticking)"
            )
        if self.without:
            alone = "" if self.second else ", and there is no other method"
            told.append(f"{' and '.join(self.without)} cannot judge it, diverging or taking more than {_SLOWER:g} times as long{alone}")
        if np.isfinite(self.methods).all():
            told.append(f"{self.rule} is {np.median(self.methods):.1e} away")
        told.append(f"uncertainty {np.median(self.uncertainty):.1e} (median), {self.uncertainty.max():.1e} (largest)")
        return "; ".join(part for part in told if part)


def patience(study: Study, of: Trace, timestep: float, *, slower: float = _SLOWER, least: float = _LEAST) -> float:
    """Seconds that a run may take beside one that is there: a motion that blew up takes as many iterations as there may be at every step.

    Args:
        study: The study.
        of: The run that is there, which a good one need not be much slower than.
        timestep: Of the run, s.
        slower: How many times as long it may take.
        least: Seconds that it may take in any case.
    """
    return max(least, slower * of.spent) + _LOOK * study.seconds / timestep


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
    until: float = math.inf,
    stage: Stage | None = None,
) -> Reference:
    """Converges a run: halves the time step until every episode is known to a target, or often enough, or as long as there is time.

    Args:
        study: The study.
        episodes: Their numbers.
        distance: Of two runs.
        target: Uncertainty that is asked for, in the unit of the distance; it decides `Reference.known` too.
        most: Halvings of the study's time step at the most, at least 2.
        setting: Name of the settings.
        law: Settings in place of hard contact by the midpoint rule; MuJoCo's, say, which Euler's rule does not judge.
        tick: Called with the fraction done.
        until: Simulated time up to which it is run, s.
        stage: When it has to be done; None is never.

    Raises:
        ValueError: The clock stopped the first run within its first control.
    """
    base, stage = _HARD if law is None else law, stage or Stage()
    tight = TIGHT if base.get("engine", "stepper") == "stepper" else {}
    finest = steps_of(study, run(study, episodes[:1], setting, **base, until=study.hold, stage=stage).timestep)
    runs: list[Trace] = []
    stopped = False
    for k in range(most + 1):
        # A run takes twice the one before it, and the second method runs at the two finest steps.
        need = 0.0 if not runs else runs[-1].spent * (2.0 if law is not None else 5.0)
        if stopped := bool(stage.limited and len(runs) >= 2 and need > stage.left):
            break
        before, now = (2.0 ** (j - most) if j >= 0 else 0.0 for j in (k - 1, k))
        told = None if tick is None else (lambda done, a=before, b=now: tick(a + done * (b - a)))
        settings = base | tight | {"timestep": study.hold / (finest * 2**k)}
        last = run(study, episodes, setting, **settings, until=until, stage=stage.one(_SHARE), tick=told)
        if stopped := last.stopped:
            if len(runs) < 2 and len(last.time):
                # Better the beginning of the episodes than nothing.
                runs, until = [*runs, last], last.reached
                continue
            break
        runs = [*runs[-2:], last]
        if len(runs) == 3 and _judged(runs, (), distance, target).uncertainty.max() <= target:
            break
    if not runs:
        raise ValueError(
            f"the first control ({study.hold:g} s) of what is right was not done in {_SHARE:.0%} of the time for it: give it more with "
            "--budget (budget=), or fewer --episodes"
        )
    second: list[Trace] = []
    rule, without = _SECOND["euler"], list[str]()
    for integrator, name in _SECOND.items() if law is None else ():
        made = _by(integrator, runs[-2:], functools.partial(run, study, episodes, setting, until=until), stage, study)
        if made is None and stage.limited and not stage.left:
            stopped = True
            break
        sound = made is not None and _sound(made, runs)
        if made is not None and (sound or not second):
            # Of rules that end, one that diverges where the first method does not is better than none: then nothing is known.
            second, rule = made, name
        if sound:
            break
        without.append(name)
    if tick:
        tick(1.0)
    return replace(_judged(runs, second, distance, target), stopped=stopped, rule=rule, without=tuple(without))


def _by(integrator: str, runs: Sequence[Trace], again: Callable[..., Trace], stage: Stage, study: Study) -> list[Trace] | None:
    """Runs by another rule at the time steps of some; None where one takes far longer, or the clock ends it."""
    made: list[Trace] = []
    for of in runs:
        settings = _HARD | TIGHT | {"integrator": integrator, "timestep": of.timestep}
        made.append(again(**settings, stage=stage.within(patience(study, of, of.timestep))))
        if made[-1].stopped:
            return None
    return made


def _sound(second: Sequence[Trace], runs: Sequence[Trace]) -> bool:
    """Whether the second method is finite wherever the first one is."""
    return all(bool((own.finite | ~of.finite).all()) for own, of in zip(second, runs[-2:], strict=True))


def _judged(runs: Sequence[Trace], second: Sequence[Trace], distance: Distance, target: float) -> Reference:
    """How well the last of up to three runs is known."""
    nothing = np.full(len(runs[-1].qpos), np.nan)
    one = distance(runs[-3], runs[-2]) if len(runs) == 3 else nothing
    two = distance(runs[-2], runs[-1]) if len(runs) > 1 else np.full(len(nothing), np.inf)
    rounding = two <= _ROUNDING
    with np.errstate(divide="ignore", invalid="ignore"):
        orders = np.where(rounding | (one <= _ROUNDING), np.nan, np.log2(one / two))
        smooth = ((orders > _SMOOTH[0]) & (orders < _SMOOTH[1])) | rounding
        richardson = two / (2.0**orders - 1.0)
    own = np.where(rounding, _ROUNDING, np.where(smooth, richardson, two))
    methods = nothing.copy()
    if len(second) == 2:
        methods = distance(runs[-1], second[-1])
        # Of a rule of first order the last difference is the error; across impacts it can be twice that.
        with np.errstate(invalid="ignore"):
            own = np.maximum(own, methods - 2.0 * distance(second[0], second[1]))
    # Infinite less infinite, and a run that the clock stopped before the horizon: nothing is known.
    own = np.where(np.isnan(own), np.inf, own)
    if len(runs) == 1:
        return Reference(tuple(runs), tuple(second), target, own, orders, smooth, methods, np.zeros(len(own)))
    good = distance.over_time(runs[-2], runs[-1]) <= target
    until = np.concatenate([[0.0], runs[-1].time])[np.where(good.all(axis=0), len(good), (~good).argmax(axis=0))]
    return Reference(tuple(runs), tuple(second), target, own, orders, smooth, methods, until)
