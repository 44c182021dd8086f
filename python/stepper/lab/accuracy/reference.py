"""Reference of a study: a run that is converged by halving the time step, with its uncertainty.

The first method is the midpoint rule, with the time steps h, h/2, h/4 and so on. Three runs x(h), x(h/2), x(h/4) give an observed order
p = log2(|x(h) - x(h/2)| / |x(h/2) - x(h/4)|), where |...| is the distance between two runs (`Distance`). In smooth motion p is the
order of the rule, and Richardson's estimate of the last run's error is |x(h/2) - x(h/4)| / (2^p - 1). Across impacts, sticking and sliding
the order varies, and the estimate is the difference of the last two runs.

The second method checks the first, because its errors are different. It is Euler's rule, at the two finest time steps. Let d be the
difference between its two runs. If the results of the two methods differ by more than 2 d, the excess is added to the uncertainty. Euler's
rule diverges with stiff damping of light links. The implicit rule, also of first order, then replaces it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.accuracy.traces import Distance, Trace, posed, run
from stepper.lab.study.batches import steps_of
from stepper.lab.study.study import Study

Array = NDArray[np.float64]
_FIRST_METHOD: dict[str, Any] = {"contact": "hard", "integrator": "midpoint"}
"""Contact law and integrator of the first method, for any options of the study."""
TIGHT: dict[str, Any] = {"tolerance": 1e-9, "iterations": 200, "precision": "f64"}
"""Settings of a run with a tight solver tolerance.

Evidence: contacts of a humanoid have rounding errors of about 1e-11 m/s. A tolerance near that uses all iterations in most steps and takes
twenty times as long.
"""
_SECOND_METHODS = {"euler": "Euler's rule", "implicit": "the implicit rule"}
"""Integrators of the second method. The first one that stays finite and finishes in time is used."""
_MIN_PATIENCE, _PATIENCE_PER_STEP = 2.0, 1e-4
"""Duration that is always allowed for a run, s, and additional duration per time step, s."""
_MAX_SLOWDOWN = 3.0
"""Largest ratio of the duration of a run with the second method to that of the run with the first method."""
_ROUNDING = 1e-11
"""Largest difference of two runs that counts as a rounding error, m or rad."""
_SMOOTH_ORDERS = (1.6, 2.6)
"""Range of observed orders of the midpoint rule in smooth motion."""


@dataclass(frozen=True)
class Reference:
    """Converged run, relative to which errors are measured, and its uncertainty.

    With hard contact, a converged run is computed by two methods: the midpoint rule at ever smaller time steps, and a rule of first order
    as a check. With another contact law, it is computed by the integrator of that law's settings alone.

    Attributes:
        runs: The three finest runs with the first method (the midpoint rule, or the integrator of another law), the finest last.
        second: Runs with the rule of first order at the two finest time steps; empty if there is no second method.
        target: Target of the uncertainty, m or rad.
        uncertainty: Uncertainty of every episode up to the horizon, (episodes,), m or rad.
        orders: Observed order of convergence of every episode, (episodes,); NaN if the differences between the runs are rounding errors.
        extrapolates: Whether Richardson's estimate applies to each episode, (episodes,).
        methods: Distance between the results of both methods, (episodes,), m or rad; NaN with one method.
        known: Time up to which the last two runs of an episode agree to the target, (episodes,), s.
        rule: Name of the rule of first order, such as "Euler's rule".
        without: Names of integrators of first order that diverged or took too long.
        measured: Measured trajectories, which replace the converged run as ground truth; None without measurements.
        noise_floor: Error that the noise of the measurement alone causes, (episodes,), m or rad; NaN without measurements.
    """

    runs: tuple[Trace, ...]
    second: tuple[Trace, ...]
    target: float
    uncertainty: Array
    orders: Array
    extrapolates: NDArray[np.bool_]
    methods: Array
    known: Array
    rule: str = _SECOND_METHODS["euler"]
    without: tuple[str, ...] = ()
    measured: Trace | None = None
    noise_floor: Array = dataclasses.field(default_factory=lambda: np.full(1, np.nan))

    @property
    def ground_truth(self) -> Trace:
        """Trajectories from which errors are computed: the measured ones, or otherwise those of the converged run."""
        return self.trace if self.measured is None else self.measured

    @property
    def ground_truth_uncertainty(self) -> Array:
        """Uncertainty of the ground truth, (episodes,), m or rad: the noise floor, or otherwise the uncertainty of the converged run."""
        return self.uncertainty if self.measured is None else self.noise_floor

    @property
    def trace(self) -> Trace:
        """Converged run with the smallest time step."""
        return self.runs[-1]

    @property
    def timestep(self) -> float:
        """Time step of the finest run, s."""
        return self.trace.timestep

    def with_distance(self, distance: Distance) -> Reference:
        """Reference with the same runs, without measured trajectories, for another definition of errors or another horizon."""
        found = _assessed(self.runs, self.second, distance, self.target)
        return replace(found, rule=self.rule, without=self.without)

    @property
    def words(self) -> str:
        """Description of the reference as a sentence: time step, observed order, second method and uncertainty."""
        smooth, n = int(self.extrapolates.sum()), len(self.extrapolates)
        orders = self.orders[np.isfinite(self.orders)]
        measured = f"measured trajectories, with a noise floor of {np.median(self.noise_floor):.1e} (median), beside a converged run"
        sentences = [
            "" if self.measured is None else measured,
            f"time steps halved to {1e6 * self.timestep:.4g} us",
            f"observed order {np.median(orders):.1f}" if len(orders) else "",
        ]
        if smooth < n:
            sentences.append(
                f"no extrapolation in {n - smooth} of {n} episodes, whose orders are not those of smooth motion (impacts, sticking)"
            )
        if self.without:
            alone = "" if self.second else ", and there is no other method"
            sentences.append(
                f"{' and '.join(self.without)} cannot check it, diverging or taking more than {_MAX_SLOWDOWN:g} times as long{alone}"
            )
        if np.isfinite(self.methods).all():
            sentences.append(f"{self.rule} differs from it by {np.median(self.methods):.1e}")
        sentences.append(f"uncertainty {np.median(self.uncertainty):.1e} (median), {self.uncertainty.max():.1e} (largest)")
        return "; ".join(part for part in sentences if part)


def patience(study: Study, of: Trace, timestep: float, *, slower: float = _MAX_SLOWDOWN, least: float = _MIN_PATIENCE) -> float:
    """Processor time after which a run is stopped, s.

    Diverging runs use all iterations of the solver in every step, and take much longer than others.

    Args:
        study: The study.
        of: Comparable run that was completed.
        timestep: Time step of the new run, s.
        slower: Largest allowed ratio of the new run's duration to that of the comparable run.
        least: Duration that is always allowed, even if the comparable run was very short, s.
    """
    return max(least, slower * of.spent) + _PATIENCE_PER_STEP * study.seconds / timestep


def check_moves(study: Study) -> Study:
    """Returns the study if its model has joints; otherwise raises ValueError, because all errors would be zero."""
    model = study.loaded[0]
    if model.nv == 0:
        raise ValueError(f"{model.name or study.name} has no joints, so that nothing moves: give it some, as <freejoint/> for a free body")
    return study


def converge(
    study: Study,
    episodes: Sequence[int],
    distance: Distance,
    *,
    target: float,
    most: int = 7,
    law: dict[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
    until: float = math.inf,
) -> Reference:
    """Computes a converged run: halves the time step until the uncertainty of every episode is below a target.

    Args:
        study: The study.
        episodes: Numbers of the episodes.
        distance: Definition of the difference of two runs.
        target: Target of the uncertainty, m or rad, which also defines `Reference.known`.
        most: Largest number of halvings of the study's time step, at least 2.
        law: Settings of the runs, such as those of MuJoCo's contact law. None selects hard contact and the midpoint rule, and a second
            method then checks the result.
        progress: Progress callback with the fraction done.
        until: Simulated time of the runs, s.
    """
    base = _FIRST_METHOD if law is None else law
    tight = TIGHT if base.get("engine", "stepper") == "stepper" else {}
    finest = steps_of(study, run(study, episodes[:1], **base, until=study.control_period).timestep)
    runs: list[Trace] = []
    for k in range(most + 1):
        before, now = (2.0 ** (j - most) if j >= 0 else 0.0 for j in (k - 1, k))
        part_tick = None if progress is None else (lambda done, a=before, b=now: progress(a + done * (b - a)))
        settings = base | tight | {"timestep": study.control_period / (finest * 2**k)}
        runs = [*runs[-2:], run(study, episodes, **settings, until=until, progress=part_tick)]
        if len(runs) == 3 and _assessed(runs, (), distance, target).uncertainty.max() <= target:
            break
    second: list[Trace] = []
    rule, without = _SECOND_METHODS["euler"], list[str]()
    for integrator, name in _SECOND_METHODS.items() if law is None else ():
        made = _runs_with(integrator, runs[-2:], functools.partial(run, study, episodes, until=until), study)
        sound = made is not None and _stays_finite(made, runs)
        if made is not None and (sound or not second):
            # A rule that diverges where the first method does not still counts: the uncertainty is then infinite.
            second, rule = made, name
        if sound:
            break
        without.append(name)
    if progress:
        progress(1.0)
    return replace(_assessed(runs, second, distance, target), rule=rule, without=tuple(without))


def with_trajectories(study: Study, episodes: Sequence[int], reference: Reference, distance: Distance) -> Reference:
    """Reference with the study's measured trajectories and their noise floor; unchanged if the study has none.

    Raises:
        ValueError: The measured trajectories have another shape, or are too few.
    """
    if study.trajectories is None:
        return reference
    every = np.asarray(study.trajectories.qpos, float)
    number, periods, nq = max(episodes) + 1, study.num_control_steps, study.loaded[0].nq
    if every.shape[0] < number or every.shape[1] < periods or every.shape[2] != nq:
        raise ValueError(
            f"measured trajectories have the shape {every.shape}, must have at least {number} episodes and {periods} control periods, "
            f"and nq = {nq} numbers"
        )
    qpos = every[list(episodes), :periods]
    noise = study.trajectories.noise * np.random.default_rng([study.seed, 1]).standard_normal(qpos.shape)
    plain, noisy = (posed(study, own, reference.trace) for own in (qpos, qpos + noise))
    return replace(reference, measured=plain, noise_floor=distance(plain, noisy))


def _runs_with(integrator: str, runs: Sequence[Trace], again: Callable[..., Trace], study: Study) -> list[Trace] | None:
    """Runs with another integrator at the time steps of given runs; None if one takes too long."""
    made: list[Trace] = []
    for of in runs:
        settings = _FIRST_METHOD | TIGHT | {"integrator": integrator, "timestep": of.timestep}
        made.append(again(**settings, patience=patience(study, of, of.timestep)))
        if made[-1].stopped:
            return None
    return made


def _stays_finite(second: Sequence[Trace], runs: Sequence[Trace]) -> bool:
    """Whether runs with the second integrator stay finite in all episodes in which the runs with the first integrator stay finite."""
    return all(bool((own.finite | ~of.finite).all()) for own, of in zip(second, runs[-2:], strict=True))


def _assessed(runs: Sequence[Trace], second: Sequence[Trace], distance: Distance, target: float) -> Reference:
    """Reference from runs at successive halvings of the time step, with an estimate of the finest run's uncertainty."""
    one, two = distance(runs[-3], runs[-2]), distance(runs[-2], runs[-1])
    rounding = two <= _ROUNDING
    with np.errstate(divide="ignore", invalid="ignore"):
        orders = np.where(rounding | (one <= _ROUNDING), np.nan, np.log2(one / two))
        smooth = ((orders > _SMOOTH_ORDERS[0]) & (orders < _SMOOTH_ORDERS[1])) | rounding
        richardson = two / (2.0**orders - 1.0)
    own = np.where(rounding, _ROUNDING, np.where(smooth, richardson, two))
    methods = np.full(len(own), np.nan)
    if len(second) == 2:
        methods = distance(runs[-1], second[-1])
        # The error of a first-order rule is about its last difference; across impacts it can be twice that.
        with np.errstate(invalid="ignore"):
            own = np.maximum(own, methods - 2.0 * distance(second[0], second[1]))
    # NaN comes from infinite distances, or from a run that was stopped before the horizon: the uncertainty is infinite.
    own = np.where(np.isnan(own), np.inf, own)
    good = distance.over_time(runs[-2], runs[-1]) <= target
    until = np.concatenate([[0.0], runs[-1].time])[np.where(good.all(axis=0), len(good), (~good).argmax(axis=0))]
    return Reference(tuple(runs), tuple(second), target, own, orders, smooth, methods, until)
