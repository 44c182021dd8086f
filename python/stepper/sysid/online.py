"""Online identification: a window that moves with the readings, and the normal distribution that is known of what lies before it.

Moving-horizon estimation (Rao, Rawlings and Mayne 2003): unknown are parameters and the state where the window begins. With every sample
Gauss-Newton steps are made on the window's residuals and on the arrival cost, which is a normal distribution of both, until the estimate
settles: one where motion is smooth (a real-time iteration, Diehl 2001), some where a contact begins. The oldest sample then leaves: a
Kalman update takes it into the arrival cost, and the motion's own derivatives take that to where the window begins next. Derivatives are
differences over what is not known yet (linear.py), from one batch of environments that also makes the prediction.

Friction that holds has no slope: less of it would slip, more changes nothing. So the batch has environments with other frictions too. One
that explains the window better is taken; one that would have slipped where nothing slips is excluded, which is a lower bound.
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

from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.shared.fields import RANDOMIZED
from stepper.sysid.data import COORDINATES, vector
from stepper.sysid.findings import undetermined
from stepper.sysid.inertia import Array
from stepper.sysid.linear import Directions
from stepper.sysid.parameters import READING, Block, FitParameter, bind, natural, write
from stepper.sysid.shift import Watch, finding
from stepper.sysid.simulate import UNTRUSTED, compared, find_channels, noise_of, solved

STEP = 1e-5
"""Least half width of differences, in the scales of parameters and in m/s (rad/s)."""
NUDGE = 1e-7
"""And of displacements, in m (rad)."""
WIDE = 0.3
"""Parameters of which less is known than this, in scales, have differences of `STEP`: what lies farther away is another motion."""
STEPS = 6
"""Gauss-Newton steps for a sample, at the most,"""
HALVINGS = 4
"""each shortened that many times until the window costs no more than before,"""
SAME = 0.01
"""but for this much: a hundredth of what a standard deviation costs."""
LITTLE = 0.1
"""Standard deviations by which the last step may move a parameter."""
NEARBY = 0.5
"""And that a step may lead away where no part of it lowers the cost."""
FLAT = 0.01
"""Sum of squares of residuals below which two frictions predict the same."""
KINKED = (*(f"{field}_friction[{column}]" for field in ("geom", "pair") for column in range(3)), "dof_frictionloss")
"""Kinds that have no slope where nothing slides."""
OTHERS = (-0.5, -0.15, 0.15, 0.5)
"""Logarithms of the ratios by which other values of these are tried at every sample, with some standard deviations more and less,"""
NEAR = 2.5
"""which are that many, of at least"""
NEAREST = 0.005
"""as a logarithm,"""
TRIED = len(OTHERS) + 3
ABOVE_BOUND = 0.02
"""And the one that is this far above the lower bound, so that the bound rises by it with every sample."""
BETTER = 1.0
"""A larger value is taken if the costs are smaller by this. One that costs at most this much more means that friction holds."""
EXCLUDED = 12.0
"""A smaller value is taken, and a value is excluded, where the costs differ by this: 3.5 standard deviations. What slides steadily and what
holds have the same forces, so that noise alone would soon find something that slides."""
WANDERS = 0.02
"""Drift of these kinds, unless another is given."""
FARTHEST = 0.5
"""Largest change of a parameter that one sample makes, in scales."""
PRIOR = 1.0
"""Standard deviation of the logarithm of a positive quantity of which nothing is said."""


@dataclass(frozen=True)
class Tracked:
    """Estimates of a `Tracker` after a sample.

    Attributes:
        time: Time of the sample since the first, s.
        labels: Names of the parameters.
        values: Estimates in their units, (n,).
        interval: 95 % intervals, (n, 2).
        determined: Whether the readings so far determine each parameter, (n,). It is also False while the estimate has not converged, if
            recent readings differ from their prediction by far more than their noise, and if readings are shifted (see `warnings`). For an
            undetermined friction, the lower end of the interval is the largest that held without slip, the upper end the prior knowledge.
        covariance: Covariance of the parameters, with logarithms for positive ones, (n, n).
        surprise: Mean square of the prediction errors of this sample, each over its noise: about 1, and much more if the model lacks
            something.
        untrusted: Share of unsolved steps in the window.
        seconds: Duration of the update, s.
        warnings: Problems of the data: readings that are one sample late or early relative to their controls.
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
    warnings: tuple[str, ...] = ()

    def __getitem__(self, label: str) -> float:
        """The estimate of a label, as `tracked["body_mass[box]"]`."""
        if label not in self.labels:
            raise KeyError(f"there is no {label!r}, there are: {', '.join(self.labels)}")
        return float(self.values[self.labels.index(label)])


@dataclass(frozen=True)
class _Linear:
    """The window about an estimate.

    Attributes:
        points: The estimate, points along all directions, other values of friction, (count, n + states).
        directions: Those of the differences.
        spans: Widths of local differences, (n + states, 2).
        made: What was predicted of all points.
        residual: Residuals of all points, (count, T, width).
        J: Derivatives at the estimate, (T, width, n + states).
        noise: Standard deviations of the residuals, with what curvature adds to the derivatives, (T, width).
        cost: Sum of squares of the window's residuals and of the distance from what was known, at the estimate.
    """

    points: Array
    directions: Directions
    spans: Array
    made: dict[str, Array]
    residual: Array
    J: Array
    noise: Array
    cost: float


class Tracker:
    """Follows parameters while a robot moves, sample by sample.

    Args:
        model: The model, with everything that is known.
        parameters: What is followed, as of `identify`; `FitParameter.prior` has their prior. Without one, a positive quantity is
            known to a factor of e, and other numbers within their bounds.
        noise: Standard deviation of each channel by name (a number, or one for every column): sensors, "qpos", "qvel", "qpos:elbow" ...
            These channels are read.
        period: Time between samples, s: a whole number of time steps.
        window: Length of the window, s.
        drift: What parameters may change by in a second, in logarithms of what is positive and in scales of the rest: a number, or one for
            each. 0 are constants, of which None makes all but friction: that has 0.02, since a window takes the moment at which something
            begins to slide, or stops, for better known than it is.
        moving: Joints whose state is not exactly known, all of them by default. Each of their degrees of freedom costs four environments.
        state_noise: What the model lacks: standard deviations of displacement (m or rad) and velocity (m/s or rad/s) that it gains in a
            second.
        options: As of `Stepper`. Where they leave the tolerance open, it is 1e-9 m/s.
        threads: As of `Stepper`.
        qpos, qvel: State at the beginning, the model's reference and 0 by default.
        start_std: What is not known of it: standard deviations of displacement and velocity.

    Raises:
        KeyError: No sensor or coordinate of a name.
        ValueError: No element of a name, what environments of one stepper must share, a window that is too short, shapes
            that do not fit, or numbers that are not finite.

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
        state_noise: tuple[float, float] = (1e-5, 1e-3),
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
        self._scale, self._low, self._high, start = (
            np.concatenate([getattr(block, name) for block in self.blocks]) for name in ("scale", "low", "high", "start")
        )
        self.n = len(start)
        fields = write(self.blocks, start[None], model)
        self.model = model.replace(**{name: array[0] for name, array in fields.fields.items()})
        if not noise:
            raise ValueError("noise names no channel; give the standard deviation of every channel that is read")
        self._channels = find_channels(self.model, noise)
        self._sigma = np.concatenate([noise_of(channel, noise[channel.name]) for channel in self._channels])
        self._dofs = list(range(model.nv)) if moving is None else _dofs(model, moving)
        kinds = [block.parameter.kind for block in self.blocks for _ in range(block.size)]
        self._kinked = [j for j, kind in enumerate(kinds) if kind in KINKED]
        self._count = 1 + 2 * (self.n + 2 * len(self._dofs)) + TRIED * len(self._kinked)
        self._sim = Stepper(self.model, self._count, options=solved(options or Options()), threads=threads)
        self.period = period
        for name, length in (("period", period), ("window", window)):
            if not math.isfinite(length):
                raise ValueError(f"{name} is {length}, must be a length of time in s, as {name}={0.02 if name == 'period' else 0.12}")
        self._nstep = round(period / float(self._sim.timestep))
        if self._nstep < 1 or abs(self._nstep * self._sim.timestep / period - 1) > 1e-3:
            raise ValueError(f"period is {period:g} s, must be a whole number of time steps of {self._sim.timestep:g} s")
        self._length = round(window / period)
        if self._length < 2:
            raise ValueError(f"window is {window:g} s, must be two periods of {period:g} s or more")
        if drift is None:
            drift = [WANDERS if kind in KINKED else 0.0 for kind in kinds]
        wander = _spread("drift", drift, self.n, f"one number, or one for each of {', '.join(self.labels)}", alone=True)
        pair = "two numbers, of displacement (m or rad) and of velocity (m/s or rad/s)"
        gained, unknown = _spread("state_noise", state_noise, 2, pair), _spread("start_std", start_std, 2, pair)
        m = len(self._dofs)
        self._drift = wander * self._scale
        self._gained = np.concatenate([self._drift, np.repeat(gained, m)]) * math.sqrt(period)
        self._begin = (
            vector("qpos", self.model.qpos0 if qpos is None else qpos, self.model.nq).copy(),
            vector("qvel", np.zeros(self.model.nv) if qvel is None else qvel, self.model.nv).copy(),
            np.zeros(self.model.na),
        )
        mean, std = _known(self.blocks)
        self._x = np.concatenate([np.clip(mean, self._low, self._high), np.zeros(2 * m)])
        self._mean = np.concatenate([mean, np.zeros(2 * m)])
        # An exact start is one that is known to a thousandth of what differences move it by.
        self._cov = np.diag(np.concatenate([std, np.maximum(np.repeat(unknown, m), 1e-3 * NUDGE)]) ** 2)
        span = (self._high - self._low) / 2
        self._reach = np.where(np.isfinite(span), span, 100.0) / self._scale
        self._bounds = {j: (-math.inf, 0.0) for j in self._kinked}
        self._samples: deque[tuple[Array, dict[str, Array]]] = deque()
        self._now = 0.0
        self._posterior: Array = self._cov.copy()
        self._watch: Watch | None = Watch()

    def update(self, ctrl: ArrayLike, readings: Mapping[str, ArrayLike]) -> Tracked:
        """Takes a sample.

        Args:
            ctrl: Controls that were in force since the sample before, (nu,).
            readings: Channels by name, as they were at the end of that period; NaN, or a channel that is absent, was not measured.

        Raises:
            KeyError: A channel that has no noise.
            ValueError: Shapes that do not fit, numbers that are not finite.
            FloatingPointError: The prediction is not finite.
        """
        began = time.perf_counter()
        given = np.asarray(ctrl, np.float64)
        if given.shape != (self.model.nu,) or not np.isfinite(given).all():
            raise ValueError(f"ctrl has shape {given.shape}, must be ({self.model.nu},) and finite")
        read = self._checked(readings)
        if self._watch is not None:
            self._watch.begin(self)
        self._samples.append((given, read))
        self._now += self.period
        at, newest, settled = self._settle()
        surprise = float((newest**2).mean()) if len(newest) else 0.0
        explained = self._watch is None or self._watch.look(given, read, surprise)
        shift = None if self._watch is None else self._watch.found
        flagged = float(((at.made["status"].astype(np.int64) & int(UNTRUSTED)) != 0).mean())
        known = self._posterior[: self.n, : self.n].copy()
        if len(self._samples) == self._length:
            self._advance(at)
        theta, std = self._x[: self.n], np.sqrt(np.diag(known))
        low, high = self._ends(theta, std)
        return Tracked(
            time=self._now,
            labels=self.labels,
            values=natural(self.blocks, theta),
            interval=np.stack([natural(self.blocks, low), natural(self.blocks, high)], axis=1),
            determined=~undetermined(self.blocks, std / self._scale, self._reach) & (settled and explained),
            covariance=known,
            surprise=surprise,
            untrusted=flagged,
            seconds=time.perf_counter() - began,
            warnings=() if shift is None else (finding(*shift),),
        )

    def sample(self, count: int, *, seed: int = 0) -> dict[str, Any]:
        """Parameters drawn from what is known now, for `Stepper.randomize`.

        Args:
            count: Environments.
            seed: Of the draws.
        """
        known = self._posterior[: self.n, : self.n]
        root = np.linalg.cholesky(known + 1e-14 * np.diag(np.diag(known)))
        drawn = self._x[: self.n] + np.random.default_rng(seed).standard_normal((count, self.n)) @ root.T
        low = np.maximum(self._low, [self._bound(j) for j in range(self.n)])
        return write(self.blocks, np.clip(drawn, low, self._high), self.model).fields

    def _checked(self, readings: Mapping[str, ArrayLike]) -> dict[str, Array]:
        known = {channel.name: channel for channel in self._channels}
        out = {}
        for name, given in readings.items():
            if name not in known:
                raise KeyError(f"no noise was given of channel {name!r}, there are: {', '.join(known)}")
            value = np.atleast_1d(np.asarray(given, np.float64))
            if value.shape != (len(known[name].columns),) or np.isinf(value).any():
                raise ValueError(f"{name!r} has shape {value.shape}, must be ({len(known[name].columns)},) and not infinite")
            out[name] = value
        return {name: out.get(name, np.full(len(channel.columns), np.nan)) for name, channel in known.items()}

    def _seen(self, readings: dict[str, Array]) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Mask of the measured columns of the residuals; those of infinite noise are ignored."""
        parts = []
        for channel in self._channels:
            finite = np.isfinite(readings[channel.name])
            size = channel.lines.stop - channel.lines.start
            parts.append(np.full(size, finite.all()) if channel.dofs or channel.quaternion else finite)
        return np.asarray(np.concatenate(parts) & np.isfinite(self._sigma))

    def _points(self) -> tuple[Array, Directions, Array]:
        """The estimate, points above and below it and other values of friction; their directions; and the widths of local differences."""
        m = len(self._dofs)
        h = np.concatenate([STEP * self._scale, np.full(m, NUDGE), np.full(m, STEP)])
        room = np.full(len(h), math.inf)
        room[: self.n] = np.minimum(self._high - self._x[: self.n], self._x[: self.n] - self._low)
        std = np.sqrt(np.diag(self._posterior))[: self.n]
        directions = Directions(self._posterior, h, room, np.flatnonzero(std > WIDE * self._scale).tolist())
        points = np.tile(self._x, (self._count, 1))
        at = 1 + 2 * len(h)
        points[1:at] = directions.points(self._x)
        for j in self._kinked:
            bound = self._bound(j)
            last = bound + ABOVE_BOUND if math.isfinite(bound) else self._x[j] + 2 * OTHERS[0]
            near = float(np.clip(NEAR * std[j], NEAREST, -OTHERS[1] / 2))
            tried = np.array([*(self._x[j] + step for step in (*OTHERS, -near, near)), last])
            points[at : at + len(tried), j] = np.clip(tried, max(self._low[j], bound), self._high[j])
            at += len(tried)
        # At a bound one side has no width: the prediction is made within bounds.
        spans = np.stack([h, h], axis=1)
        for j in range(self.n):
            spans[j] = min(self._x[j] + h[j], self._high[j]) - self._x[j], self._x[j] - max(self._x[j] - h[j], self._low[j])
        return points, directions, spans

    def _predict(self, points: Array) -> tuple[dict[str, Array], Array]:
        """States and readings of the window from these points, and residuals (count, T, width)."""
        m, nv = len(self._dofs), self.model.nv
        shift = np.zeros((2, len(points), nv))
        shift[0][:, self._dofs], shift[1][:, self._dofs] = points[:, self.n : self.n + m], points[:, self.n + m :]
        theta = np.clip(points[:, : self.n], self._low, self._high)
        self._sim.randomize(**write(self.blocks, theta, self.model).fields)
        self._sim.reset()
        qpos = self.model.integrate_pos(np.tile(self._begin[0], (len(points), 1)), shift[0])
        act = np.tile(self._begin[2], (len(points), 1))
        self._sim.set_state(qpos, self._begin[1] + shift[1], act=act, time=0.0)
        ctrl = np.repeat(np.stack([c for c, _ in self._samples])[:, None], len(points), axis=1)
        fields = sorted({*(channel.field for channel in self._channels), *COORDINATES})
        made: dict[str, Array] = self._sim.rollout(ctrl, self._nstep, fields=fields)
        out = np.zeros((len(points), len(ctrl), len(self._sigma)))
        for channel in self._channels:
            measured = np.stack([readings[channel.name] for _, readings in self._samples])
            value = compared(self.model, channel, made[channel.field], measured)
            if not channel.dofs and not channel.quaternion:
                value = np.where(np.isfinite(measured)[:, None], value - measured[:, None], 0.0)
            out[..., channel.lines] = value.transpose(1, 0, 2) / self._sigma[channel.lines]
        if not np.isfinite(out).all():
            raise FloatingPointError(
                f"the prediction of the window that ends at {self._now:g} s is not finite; begin again with a new Tracker"
            )
        return made, out

    def _profiles(self, points: Array, residual: Array, J: Array) -> list[tuple[Array, Array, Array]]:
        """Costs of the values that were tried for each friction, the estimate first, once all other numbers have made the best of them.

        Returns:
            Indices of the points; costs by the window, with what is known of the other numbers; costs with what is known of friction too.
        """
        out = []
        N = len(self._x)
        whole = np.linalg.inv(np.linalg.cholesky(self._cov))
        for k, j in enumerate(self._kinked):
            first = 1 + 2 * N + k * TRIED
            index = np.array([0, *range(first, first + TRIED)])
            left = residual[index].reshape(len(index), -1)
            others = np.delete(np.arange(N), j)
            slope = J.reshape(-1, N)[:, others]
            root = np.linalg.inv(np.linalg.cholesky(self._cov[np.ix_(others, others)]))
            apart = points[index] - self._mean
            window = _least(np.concatenate([slope, root]), np.concatenate([left, apart[:, others] @ root.T], axis=1))
            known = _least(np.concatenate([slope, whole[:, others]]), np.concatenate([left, apart @ whole.T], axis=1))
            out.append((index, window, known))
        return out

    def _other(self, points: Array, residual: Array, J: Array) -> tuple[Array | None, list[int]]:
        """A point with another friction that explains the window better; and frictions that hold.

        For a friction that holds, the window only determines that it is large enough. Where the estimate slips a little and
        the readings do not, the slope there gives the friction that just holds; all larger values explain the window as well. What would
        have slipped raises the lower bound.
        """
        best, gain, holding = 0, 0.0, []
        for j, (index, window, known) in zip(self._kinked, self._profiles(points, residual, J), strict=True):
            tried = points[index, j]
            gone = tried[(tried < tried[window.argmin()]) & (window > window.min() + EXCLUDED)]
            if len(gone) and gone.max() > self._bound(j):
                self._bounds[j] = float(gone.max()), self._now
            if window[tried.argmax()] <= window.min() + BETTER and self._flat(residual[index], tried):
                holding.append(j)
            needed = np.where(tried < tried[0], EXCLUDED, BETTER)
            excess = known[0] - known - needed
            if excess.max() > gain:
                best, gain = int(index[excess.argmax()]), float(excess.max())
        return (points[best] if best else None), holding

    @staticmethod
    def _flat(residual: Array, tried: Array) -> bool:
        """Whether the two largest frictions predict the same: what slides in both determines friction and mass together only."""
        one, other = residual[np.argsort(tried)[-2:]]
        return float(((one - other) ** 2).sum()) < FLAT

    def _bound(self, j: int) -> float:
        """Lower bound of a number of theta, which what may have changed since lowers."""
        if j not in self._bounds:
            return -math.inf
        value, when = self._bounds[j]
        return value - 3 * float(self._drift[j]) * math.sqrt(max(self._now - when, 0.0))

    def _settle(self) -> tuple[_Linear, Array, bool]:
        """Gauss-Newton steps until the estimate moves by little of what is not known of it.

        One step would do where motion is smooth. Where a contact begins, the slopes after the step are others, and a covariance of the
        slopes before it would be that of another estimate.

        Returns:
            What the window is at the estimate, residuals of the newest sample before the first step, and whether the estimate has settled.
        """
        best, jumped = self._linear(), False
        newest = best.residual[0, -1][self._seen(self._samples[-1][1])]
        for _ in range(STEPS):
            other, holding = self._other(best.points, best.residual, best.J)
            if other is not None and not jumped:
                self._x, jumped = other.copy(), True
                best = self._linear()
                continue
            best.J[..., holding] = 0.0
            step, self._posterior = self._gauss_newton(best)
            moved = np.abs(step[: self.n]) > LITTLE * np.sqrt(np.diag(self._posterior))[: self.n]
            moved[holding] = False
            if not moved.any():
                self._move(best.points[0], step)
                return best, newest, True
            share = 1.0
            for _ in range(HALVINGS):
                self._move(best.points[0], share * step)
                tried = self._linear()
                if tried.cost <= best.cost + SAME:
                    break
                share /= 2
            else:
                # The cost is jagged, as where something begins to slip. It is settled if its slopes do not lead far away.
                self._x = best.points[0].copy()
                far = np.abs(step[: self.n]) > NEARBY * np.sqrt(np.diag(self._posterior))[: self.n]
                far[holding] = False
                return best, newest, not far.any()
            best = tried
        self._x = best.points[0].copy()
        _, holding = self._other(best.points, best.residual, best.J)
        best.J[..., holding] = 0.0
        _, self._posterior = self._gauss_newton(best)
        return best, newest, False

    def _linear(self) -> _Linear:
        """The window about the estimate."""
        points, directions, spans = self._points()
        made, residual = self._predict(points)
        J, curved = directions.derivative(residual[: 1 + 2 * len(self._x)], spans)
        noise = np.sqrt(1 + (curved**2).sum(axis=0))
        apart = np.linalg.solve(np.linalg.cholesky(self._cov), self._x - self._mean)
        cost = float((residual[0] ** 2).sum() + (apart**2).sum())
        return _Linear(points, directions, spans, made, residual, J.transpose(1, 2, 0).copy(), noise, cost)

    def _gauss_newton(self, at: _Linear) -> tuple[Array, Array]:
        """A step on the window and the arrival cost, and the covariance of what is known then."""
        N = len(self._x)
        root = np.linalg.cholesky(self._cov)
        rows = np.concatenate([(at.J / at.noise[..., None]).reshape(-1, N), np.linalg.solve(root, np.eye(N))])
        left = np.concatenate([(at.residual[0] / at.noise).ravel(), np.linalg.solve(root, at.points[0] - self._mean)])
        # Columns are of very different sizes.
        size = np.linalg.norm(rows, axis=0)
        step = -np.linalg.lstsq(rows / size, left, rcond=None)[0] / size
        step *= min(1.0, FARTHEST / max(float((np.abs(step[: self.n]) / self._scale).max()), 1e-300))
        inverse = np.linalg.inv((rows / size).T @ (rows / size)) / np.outer(size, size)
        return step, np.asarray((inverse + inverse.T) / 2)

    def _move(self, start: Array, step: Array) -> None:
        """Sets the estimate to a step from a point, within bounds."""
        self._x = start + step
        low = np.maximum(self._low, [self._bound(j) for j in range(self.n)])
        self._x[: self.n] = np.clip(self._x[: self.n], low, self._high)

    def _advance(self, at: _Linear) -> None:
        """The oldest sample leaves the window: the arrival cost takes it in, and goes on to where the window begins next."""
        N, m = len(self._x), len(self._dofs)
        linearized, J, residual = at.points[0], at.J[0] / at.noise[0][:, None], at.residual[0, 0] / at.noise[0]
        gain = np.linalg.solve(J @ self._cov @ J.T + np.eye(len(J)), J @ self._cov).T
        mean = self._mean - gain @ (residual + J @ (self._mean - linearized))
        keep = np.eye(N) - gain @ J
        cov = keep @ self._cov @ keep.T + gain @ gain.T
        qpos, qvel = at.made["qpos"][0], at.made["qvel"][0]
        moved = self.model.differentiate_pos(np.tile(qpos[0], (2 * N, 1)), qpos[1 : 1 + 2 * N])[:, self._dofs]
        states = np.concatenate([moved, (qvel[1 : 1 + 2 * N] - qvel[0])[:, self._dofs]], axis=1)
        states = np.concatenate([np.zeros((1, 2 * m)), states])
        slope, curved = at.directions.derivative(states[:, None], at.spans)
        F = np.eye(N)
        F[self.n :] = slope[:, 0].T
        self._mean = np.concatenate([mean[: self.n], F[self.n :] @ (mean - linearized)])
        self._x = np.concatenate([self._x[: self.n], F[self.n :] @ (self._x - linearized)])
        # What contacts hold exactly has no variance; without any, it could not be inverted.
        gained = np.diag(self._gained**2 + np.concatenate([np.zeros(self.n), np.full(2 * m, (1e-3 * NUDGE) ** 2)]))
        gained[self.n :, self.n :] += curved[:, 0].T @ curved[:, 0]
        cov, posterior = (F @ what @ F.T + gained for what in (cov, self._posterior))
        self._cov, self._posterior = (cov + cov.T) / 2, (posterior + posterior.T) / 2
        self._begin = qpos[0].copy(), qvel[0].copy(), at.made["act"][0, 0].copy()
        self._samples.popleft()

    def _ends(self, theta: Array, std: Array) -> tuple[Array, Array]:
        """Ends of 95 % intervals of theta: of a normal distribution, within bounds."""
        low = np.maximum(self._low, [self._bound(j) for j in range(self.n)])
        return np.clip(theta - 1.96 * std, low, self._high), np.clip(theta + 1.96 * std, low, self._high)


def _least(A: Array, b: Array) -> Array:
    """Least sums of squares of rows b (count, m) minus what the columns of A (m, k) span, (count,)."""
    Q = np.linalg.qr(A / np.linalg.norm(A, axis=0))[0]
    return np.asarray((b**2).sum(axis=1) - ((b @ Q) ** 2).sum(axis=1))


def _spread(name: str, given: ArrayLike, size: int, remedy: str, *, alone: bool = False) -> Array:
    """Standard deviations, (size,), of an argument."""
    value = np.asarray(given, np.float64)
    if value.shape != (size,) and not (alone and value.ndim == 0):
        raise ValueError(f"{name} has shape {value.shape}, must be {remedy}")
    if not (np.isfinite(value).all() and (value >= 0).all()):
        raise ValueError(f"{name} is {value.tolist()}, must be standard deviations, which are finite and not negative; 0 is none")
    return np.broadcast_to(value, (size,))


def _dofs(model: Model, names: Sequence[str]) -> list[int]:
    joints = [model.joint(name) for name in names]
    return [dof for joint in joints for dof in range(joint.dofadr, joint.dofadr + joint.nv)]


def _known(blocks: Sequence[Block]) -> tuple[Array, Array]:
    """Mean and standard deviation of theta before the first sample."""
    means, stds = [], []
    for block in blocks:
        if block.prior is not None:
            mean, std = block.prior
        elif block.kind.log:
            mean, std = block.start, np.full(block.size, PRIOR)
        else:
            mean, std = block.start, (block.high - block.low) / 4
        if not np.isfinite(std).all():
            raise ValueError(f"{block.parameter}: nothing bounds it; give a prior, as FitParameter(..., prior=(mean, standard deviation))")
        means.append(mean)
        stds.append(std)
    return np.concatenate(means), np.concatenate(stds)
