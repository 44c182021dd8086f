"""Online identification (`Tracker`): estimates and intervals of parameters after every sample, from a mixture of hypotheses about friction.

Near the onset of slip, readings often do not show whether an object has slipped, and the two cases give different masses. An immediate
decision would make all later intervals too narrow. A rival (another friction that explains the readings, rivals.py) therefore
starts another hypothesis (a Gaussian sum, Alspach and Sorenson 1972), weighted by Laplace's approximation of its evidence. If an object
slips in all hypotheses, a hypothesis is added in which friction holds the object, and the object's mass is estimated again. Hypotheses
with little weight are dropped.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stepper._arrays import array_of
from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.shared.arguments import check_mapping, check_number
from stepper.shared.fields import RANDOMIZED
from stepper.sysid.data import vector
from stepper.sysid.horizon import POSITION_STEP, Horizon
from stepper.sysid.inertia import Array
from stepper.sysid.parameters import READING, Block, FitParameter, bind, natural, write
from stepper.sysid.problem import MAX_PREDICTIONS, Problem, Sample
from stepper.sysid.rivals import KINKED, OTHERS_PER_FRICTION, TWO_SIDED
from stepper.sysid.simulate import UNTRUSTED, find_channels, noise_of, solved
from stepper.sysid.uncertainty import RIDGE, root_of, undetermined

MAX_HYPOTHESES = 4
"""Largest number of a tracker's hypotheses about friction."""
UNLIKELY = 0.01
"""Probability below which a hypothesis is dropped. It is less than the 2.5 % beyond each end of a 95 % interval."""
CLOSE = 0.05
"""Difference of log(friction) between a point and a hypothesis below which the point starts no new hypothesis."""
CLOSE_STD = 3.0
"""Difference of log(friction) between a point and a hypothesis below which the point starts no new hypothesis.

It is in standard deviations of the hypothesis. The larger of this limit and `CLOSE` applies.
"""
MERGE_DISTANCE = 0.3
"""Largest difference of the estimates of two hypotheses that are merged, in units of the smaller of their standard deviations."""
MERGE_STD_RATIO = 1.5
"""Largest ratio of the standard deviations of two hypotheses that are merged."""


@dataclass(frozen=True)
class Mixture:
    """Weighted sum of normal distributions of the n parameters (the vector theta), one under each of k hypotheses.

    Attributes:
        weights: Probability of each hypothesis, (k,).
        means: Mean of the parameters under each hypothesis, (k, n).
        covariances: Covariance of the parameters under each hypothesis, (k, n, n).
        lows: Lower bounds of the parameters under each hypothesis, (k, n).
        high: Upper bounds of the parameters under all hypotheses, (n,).
    """

    weights: Array
    means: Array
    covariances: Array
    lows: Array
    high: Array

    def mean(self) -> Array:
        """Mean of the parameter vector theta, (n,)."""
        return np.asarray(self.weights @ self.means)

    def covariance(self) -> Array:
        """Covariance of the parameter vector theta, (n, n)."""
        apart = self.means - self.mean()
        return np.asarray(np.einsum("k,kij->ij", self.weights, self.covariances + apart[:, :, None] * apart[:, None, :]))

    def quantile(self, sigmas: float) -> Array:
        """Quantiles of the parameter vector theta, clipped to the bounds, (n,).

        Args:
            sigmas: Probability of the quantile, as the number of standard deviations of a normal distribution: 1.96 is 97.5 %.
        """
        stds = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))
        ends = np.clip(self.means + sigmas * stds, self.lows, self.high)
        if len(ends) == 1:
            return np.asarray(ends[0])
        return np.array([self._quantile(j, sigmas, ends[:, j], stds[:, j]) for j in range(len(self.high))])

    def _quantile(self, j: int, sigmas: float, ends: Array, std: Array) -> float:
        """Quantile of one parameter of the mixture, by bisection between the quantiles of its normal distributions, `ends` (k,).

        `sigmas` gives its probability, as the number of standard deviations of a normal distribution: 1.96 is 97.5 %.
        """
        low, high, share = float(ends.min()), float(ends.max()), _normal(sigmas)
        for _ in range(50):
            middle = (low + high) / 2
            below = [
                1.0 if middle >= self.high[j] else 0.0 if middle < bound else _normal((middle - mean) / s)
                for mean, s, bound in zip(self.means[:, j], std, self.lows[:, j], strict=True)
            ]
            low, high = (low, middle) if float(self.weights @ below) >= share else (middle, high)
        return (low + high) / 2

    def draw(self, count: int, seed: int) -> Array:
        """Random parameter vectors theta from the mixture, clipped to the bounds, (count, n)."""
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal((count, len(self.high)))
        chosen = rng.choice(len(self.weights), count, p=self.weights)
        roots = root_of(self.covariances, RIDGE)
        drawn = self.means[chosen] + np.einsum("cij,cj->ci", roots[chosen], normal)
        return np.asarray(np.clip(drawn, self.lows[chosen], self.high))


def mixture_of(hypotheses: Sequence[Horizon], problem: Problem) -> Mixture:
    """Distribution of the parameters: the weighted sum of their normal distributions under some hypotheses."""
    n = problem.n
    return Mixture(
        weights_of(hypotheses),
        np.stack([h.x[:n] for h in hypotheses]),
        np.stack([h.posterior[:n, :n] for h in hypotheses]),
        np.stack([h.low() for h in hypotheses]),
        problem.high,
    )


def weights_of(hypotheses: Sequence[Horizon]) -> Array:
    """Probabilities of hypotheses, (k,), from the evidence of each; their sum is 1."""
    evidence = np.array([h.evidence for h in hypotheses])
    share = np.exp(evidence - evidence.max())
    return np.asarray(share / share.sum())


def updated(hypotheses: Sequence[Horizon], sample: Sample, problem: Problem) -> list[Horizon]:
    """Hypotheses after a new sample, the most probable first.

    A point with another friction that explains the readings starts a new hypothesis, if predictions are left for it. Improbable hypotheses
    are dropped.

    Args:
        hypotheses: Hypotheses before the sample.
        sample: Controls and readings.
        problem: Fixed data of the tracker.
    """
    for hypothesis in hypotheses:
        hypothesis.take(sample)
    out = list(hypotheses)
    for hypothesis in hypotheses:
        if problem.budget.left <= 0:
            break
        if hypothesis.rival is None or any(_near(other, hypothesis.rival, problem) for other in out if other is not hypothesis):
            continue
        try:
            child = hypothesis.branch(hypothesis.rival)
        except (FloatingPointError, np.linalg.LinAlgError):
            # Parameters whose prediction is not finite have the probability 0.
            continue
        if not any(_alike(child, other, problem) for other in out):
            out.append(child)
    return _likely(out + _held(out, problem), problem)


def _held(hypotheses: Sequence[Horizon], problem: Problem) -> list[Horizon]:
    """New hypotheses in which an object sticks, for frictions at which the object slips in all given hypotheses."""
    out: list[Horizon] = []
    for hypothesis in hypotheses:
        for j in hypothesis.worth_trying_held():
            if problem.budget.left <= 0 or any(other.holds(j) for other in (*hypotheses, *out)):
                continue
            try:
                held = hypothesis.held(j)
            except (FloatingPointError, np.linalg.LinAlgError):
                continue
            if held is not None:
                out.append(held)
    return out


def _likely(hypotheses: list[Horizon], problem: Problem) -> list[Horizon]:
    """Most probable of some hypotheses, at most `MAX_HYPOTHESES`, in descending order; similar hypotheses are merged."""
    kept: list[Horizon] = []
    for hypothesis in sorted(hypotheses, key=lambda h: -h.evidence):
        for other in kept:
            if _alike(hypothesis, other, problem):
                other.absorb(hypothesis.evidence)
                break
        else:
            kept.append(hypothesis)
    weights = weights_of(kept)
    return [h for h, weight in zip(kept, weights, strict=True) if weight >= UNLIKELY][:MAX_HYPOTHESES]


def _near(hypothesis: Horizon, x: Array, problem: Problem) -> bool:
    """Whether the frictions of a point x, (n + states,), are so close to those of a hypothesis that x needs no new hypothesis."""
    std = np.sqrt(np.diag(hypothesis.posterior))
    return all(abs(hypothesis.x[j] - x[j]) <= max(CLOSE, CLOSE_STD * std[j]) for j in problem.kinked)


def _alike(one: Horizon, other: Horizon, problem: Problem) -> bool:
    """Whether two hypotheses have nearly the same distribution of the parameters, so that they can be merged."""
    n = problem.n
    stds = np.sqrt([np.diag(one.posterior)[:n], np.diag(other.posterior)[:n]])
    least, most = stds.min(axis=0), stds.max(axis=0)
    return bool((np.abs(one.x[:n] - other.x[:n]) <= MERGE_DISTANCE * least).all() and (most <= MERGE_STD_RATIO * least).all())


def _normal(z: float) -> float:
    """Cumulative distribution function of the standard normal distribution at z."""
    return math.erfc(-z / math.sqrt(2)) / 2


FRICTION_DRIFT = 0.02
"""Default drift of friction in a `Tracker`: standard deviation of the random change of its logarithm in one second."""
STATE_NOISE = (1e-5, 1e-3)
"""Standard deviations of the random change of positions, m or rad, and velocities, m/s or rad/s, in one second: errors of the model."""
PRIOR = 1.0
"""Default prior standard deviation of the logarithm of a positive quantity."""
LEAST_WEIGHT = 0.05
"""Probability above which a hypothesis that has not converged makes all parameters count as undetermined."""
RECENT = 15
"""Number of samples over which the normalised innovation squared is averaged."""
UNEXPLAINED = 3.0
"""Mean normalised innovation squared (squared prediction error over its variance) above which the model does not explain the readings."""


@dataclass(frozen=True)
class TrackedParameter:
    """Estimates of a `Tracker` after a sample.

    Attributes:
        time: Time of the sample, s: number of samples so far times the period.
        labels: Names of the parameters.
        values: Estimates in their units, (n,): weighted means over the tracker's hypotheses about friction.
        interval: 95 % intervals in the same units, (n, 2).
        determined: Whether the readings so far determine each parameter, (n,). All are False if the estimate has not converged. They
            are also False if the mean squared prediction error of the last 15 samples is at least three times its variance. The model is
            then wrong, or readings and controls are shifted by a sample: `identify` tells which. The interval of an undetermined value is
            infinite: from 0 for a positive quantity, otherwise from minus infinity. That of an undetermined friction begins at the largest
            value that the readings exclude.
        covariance: Covariance of the parameter vector theta, which has the logarithms of positive quantities, (n, n).
        surprise: Mean square of the prediction errors of this sample, each divided by its noise: about 1 for a correct model, much more
            for a wrong one.
        untrusted: Fraction of the simulated periods in the window whose steps were not solved.
        seconds: Computing time of the update, s.
    """

    time: float
    labels: tuple[str, ...]
    values: Array
    interval: Array
    determined: np.ndarray[Any, np.dtype[np.bool_]]
    covariance: Array
    surprise: float
    untrusted: float
    seconds: float

    def __getitem__(self, label: str) -> float:
        """Estimate of a parameter by its label, in its unit: `tracked["body_mass[box]"]`."""
        if label not in self.labels:
            raise KeyError(f"there is no {label!r}, there are: {', '.join(self.labels)}")
        return float(self.values[self.labels.index(label)])


class Tracker:
    """Online estimator of model parameters: it updates its estimates with every sample while a robot moves.

    Args:
        model: Model with the known parameters.
        parameters: Unknown parameters, as in `identify`. The default of `FitParameter.prior` is a standard deviation of 1 for the logarithm
            of a positive quantity, and a quarter of the width of the bounds for others.
        noise: Standard deviation of each measured channel, by name: sensors, "qpos", "qvel", "qpos:elbow" ... It is a number, or one per
            column, in the channel's unit.
        period: Time between samples, s: a whole number of time steps.
        window: Length of the window of recent samples that are simulated again at each update, s.
        drift: Standard deviation of the random change of each parameter in one second: a number, or (n,). For a positive quantity it is
            the change of the logarithm; for others it is in units of the parameter's scale. 0 means a constant parameter. None uses 0.02
            for friction and 0 for other parameters. (A window overestimates the information about friction when sliding begins.)
        moving: Names of the joints whose state is uncertain; None selects all joints. Each degree of freedom of these joints needs four
            environments.
        options: Options of the step; the default tolerance is 1e-9 m/s.
        threads: Number of threads; 0 uses all cores.
        qpos, qvel: Initial state, (nq,) m and rad, (nv,) m/s and rad/s; None uses the model's reference pose, and zero velocity.
        start_std: Standard deviations of the initial positions (m or rad) and velocities (m/s or rad/s).

    Raises:
        TypeError: An argument has another type.
        KeyError: A channel is neither a sensor nor a coordinate of the model.
        ValueError: An element is unknown, a parameter cannot differ between the environments of a stepper, the window is too short, a
            shape is wrong, or a number is not finite.

    Example:
        parameters = ["body_mass[box]", "geom_friction[left,right,box][0]"]
        tracker = stepper.sysid.Tracker(model, parameters, noise={"wrist_force": 0.3}, period=0.02)
        while True:
            now = tracker.update(ctrl, {"wrist_force": read()})
    """

    def __init__(
        self,
        model: Model,
        parameters: Sequence[FitParameter | str],
        *,
        noise: Mapping[str, ArrayLike],
        period: float,
        window: float = 0.12,
        drift: float | Sequence[float] | None = None,
        moving: Sequence[str] | None = None,
        options: Options | None = None,
        threads: int = 1,
        qpos: ArrayLike | None = None,
        qvel: ArrayLike | None = None,
        start_std: tuple[float, float] = (1e-4, 1e-3),
    ):
        self.blocks = bind(parameters, model)
        for block in self.blocks:
            fields = write([block], block.start[None], model)
            if block.parameter.kind in READING or fields.delays or set(fields.fields) - RANDOMIZED.keys():
                raise ValueError(
                    f"{block.parameter} cannot be followed sample by sample; find it in a recording with stepper.sysid.identify"
                )
        self.labels = tuple(label for block in self.blocks for label in block.labels)
        scale, low, high, start = (
            np.concatenate([getattr(block, name) for block in self.blocks]) for name in ("scale", "low", "high", "start")
        )
        n = len(start)
        fields = write(self.blocks, start[None], model)
        self.model = model.replace(**{name: array[0] for name, array in fields.fields.items()})
        check_mapping("noise", noise, '{"wrist_force": 0.3}')
        if not noise:
            raise ValueError("noise is empty, must have the standard deviation of every channel that is read, as {'wrist_force': 0.3}")
        channels = find_channels(self.model, noise)
        dofs = list(range(model.nv)) if moving is None else _dofs(model, moving)
        kinds = [block.parameter.kind for block in self.blocks for _ in range(block.size)]
        kinked = [j for j, kind in enumerate(kinds) if kind in KINKED]
        count = 1 + 2 * (n + 2 * len(dofs)) + OTHERS_PER_FRICTION * len(kinked)
        sim = Stepper(self.model, count, options=solved(options or Options()), threads=threads)
        self.period = period
        for name, seconds in (("period", period), ("window", window)):
            check_number(f"{name} (s)", seconds, above=0.0)
        nstep, length = round(period / float(sim.timestep)), round(window / period)
        if nstep < 1 or abs(nstep * sim.timestep / period - 1) > 1e-3:
            raise ValueError(f"period is {period:g} s, must be a whole number of time steps of {sim.timestep:g} s")
        if length < 2:
            raise ValueError(f"window is {window:g} s, must be two periods of {period:g} s or more")
        if drift is None:
            drift = [FRICTION_DRIFT if kind in KINKED else 0.0 for kind in kinds]
        wander = _spread("drift", drift, n, f"one number, or one for each of {', '.join(self.labels)}", alone=True) * scale
        unknown = _spread("start_std", start_std, 2, "two numbers, of displacement (m or rad) and of velocity (m/s or rad/s)")
        m = len(dofs)
        self._problem = Problem(
            model=self.model,
            blocks=tuple(self.blocks),
            sim=sim,
            nstep=nstep,
            channels=tuple(channels),
            sigma=np.concatenate([noise_of(channel, noise[channel.name]) for channel in channels]),
            dofs=dofs,
            low=low,
            high=high,
            scale=scale,
            kinked=kinked,
            drift=wander,
            gained=np.concatenate([wander, np.repeat(STATE_NOISE, m)]) * math.sqrt(period),
            period=period,
            length=length,
        )
        begin = (
            vector("qpos", self.model.qpos0 if qpos is None else qpos, self.model.nq).copy(),
            vector("qvel", np.zeros(self.model.nv) if qvel is None else qvel, self.model.nv).copy(),
            np.zeros(self.model.na),
        )
        mean, std = _prior(self.blocks)
        # A standard deviation of 0 is replaced by a thousandth of the width of the finite differences.
        cov = np.diag(np.concatenate([std, np.maximum(np.repeat(unknown, m), 1e-3 * POSITION_STEP)]) ** 2)
        self._hypotheses = [Horizon(self._problem, np.concatenate([mean, np.zeros(2 * m)]), cov, begin)]
        span = (high - low) / 2
        self._reach = np.where(np.isfinite(span), span, 100.0) / scale
        self._now = 0.0
        self._surprises: deque[float] = deque(maxlen=RECENT)

    def update(self, ctrl: ArrayLike, readings: Mapping[str, ArrayLike]) -> TrackedParameter:
        """Adds a sample, and updates the estimates.

        Args:
            ctrl: Controls since the previous sample, (nu,), in the actuators' units.
            readings: Readings at the end of the period by channel, (dim,) or a number, in the channel's unit. NaN, or an absent channel,
                means not measured.

        Returns:
            Estimates after the sample.

        Raises:
            KeyError: A channel has no entry in `noise`.
            ValueError: A shape is wrong, or a number is not finite.
            FloatingPointError: The prediction is not finite.
        """
        began = time.perf_counter()
        given = array_of("ctrl", ctrl)
        if given.shape != (self.model.nu,) or not np.isfinite(given).all():
            raise ValueError(f"ctrl has shape {given.shape}, must be ({self.model.nu},) and finite")
        read = self._checked(readings)
        self._problem.budget.left = MAX_PREDICTIONS
        self._now += self.period
        self._hypotheses = updated(self._hypotheses, (given, read), self._problem)
        best, mixture = self._hypotheses[0], self._mixture()
        surprise = float((best.newest**2).mean()) if len(best.newest) else 0.0
        self._surprises.append(best.normalized_innovation)
        explained = len(self._surprises) < RECENT or float(np.mean(self._surprises)) <= UNEXPLAINED
        settled = all(h.settled for h, weight in zip(self._hypotheses, mixture.weights, strict=True) if weight >= LEAST_WEIGHT)
        flagged = float(((best.at.made["status"].astype(np.int64) & int(UNTRUSTED)) != 0).mean())
        for hypothesis in self._hypotheses:
            hypothesis.leave()
        covariance = mixture.covariance()
        std = np.sqrt(np.diag(covariance)) / self._problem.scale
        determined = ~undetermined(self.blocks, std, self._reach) & (settled and explained)
        return TrackedParameter(
            time=self._now,
            labels=self.labels,
            values=natural(self.blocks, mixture.mean()),
            interval=self._interval(mixture, determined, trusted=settled and explained),
            determined=determined,
            covariance=covariance,
            surprise=surprise,
            untrusted=flagged,
            seconds=time.perf_counter() - began,
        )

    def sample(self, count: int, *, seed: int = 0) -> dict[str, Any]:
        """Returns random parameters from the current distribution, for `Stepper.randomize`.

        Args:
            count: Number of environments.
            seed: Seed of the random numbers.

        Returns:
            Arrays by field, (count, ...), in the field's unit.
        """
        return write(self.blocks, self._mixture().draw(count, seed), self.model).fields

    def _interval(self, mixture: Mixture, determined: np.ndarray[Any, np.dtype[np.bool_]], *, trusted: bool) -> Array:
        """95 % intervals of the values, (n, 2); infinite for values that are not determined.

        They have the bounds of frictions only if the estimate is `trusted`: it has converged and explains the readings.
        """
        low, high = (natural(self.blocks, mixture.quantile(z)) for z in (-TWO_SIDED, TWO_SIDED))
        least = np.concatenate([block.least for block in self.blocks])
        bound = mixture.lows.min(axis=0)
        excluded = np.where(trusted & (bound > self._problem.low), natural(self.blocks, bound), least)
        return np.stack([np.where(determined, low, excluded), np.where(determined, high, np.inf)], axis=1)

    def _mixture(self) -> Mixture:
        """Current distribution of the parameters: the weighted sum of normal distributions of the tracker's hypotheses."""
        return mixture_of(self._hypotheses, self._problem)

    def _checked(self, readings: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Readings of a sample for all channels of the tracker, (columns,) each, after a check; NaN for absent channels."""
        known = {channel.name: channel for channel in self._problem.channels}
        check_mapping("readings", readings, '{"wrist_force": [0.1, 0.0, 2.3]}')
        out = {}
        for name, given in readings.items():
            if name not in known:
                raise KeyError(f"no noise was given of channel {name!r}, there are: {', '.join(known)}")
            value = np.atleast_1d(array_of(f"readings[{name!r}]", given))
            if value.shape != (len(known[name].columns),) or np.isinf(value).any():
                raise ValueError(f"{name!r} has shape {value.shape}, must be ({len(known[name].columns)},) and not infinite")
            out[name] = value
        return {name: out.get(name, np.full(len(channel.columns), np.nan)) for name, channel in known.items()}


def _spread(name: str, given: ArrayLike, size: int, remedy: str, *, alone: bool = False) -> Array:
    """Standard deviations, (size,), from the user's argument `name`, after a check of its shape and values.

    `remedy` describes the required shape in the error message. With `alone`, a single number for all is accepted.
    """
    value = array_of(name, given)
    if value.shape != (size,) and not (alone and value.ndim == 0):
        raise ValueError(f"{name} has shape {value.shape}, must be {remedy}")
    if not (np.isfinite(value).all() and (value >= 0).all()):
        raise ValueError(f"{name} is {value.tolist()}, must be standard deviations, which are finite and not negative; 0 is none")
    return np.broadcast_to(value, (size,))


def _dofs(model: Model, names: Sequence[str]) -> list[int]:
    """Indices of the degrees of freedom of the named joints."""
    if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"moving is {names!r}, must be a list of names of joints, or None for all")
    joints = [model.joint(name) for name in names]
    return [dof for joint in joints for dof in range(joint.dofadr, joint.dofadr + joint.nv)]


def _prior(blocks: Sequence[Block]) -> tuple[Array, Array]:
    """Mean and standard deviation of the parameter vector theta before the first sample, (n,) each."""
    means, stds = [], []
    for block in blocks:
        if block.prior is not None:
            mean, std = block.prior
        elif block.kind.log:
            mean, std = block.start, np.full(block.size, PRIOR)
        else:
            mean, std = block.start, (block.high - block.low) / 4
        if not np.isfinite(std).all():
            raise ValueError(
                f"{block.parameter}: it has no bounds and no prior; give a prior, as FitParameter(..., prior=(mean, standard deviation))"
            )
        means.append(mean)
        stds.append(std)
    return np.concatenate(means), np.concatenate(stds)
