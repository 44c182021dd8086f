"""Moving-horizon estimate under one hypothesis: a window of recent samples, and an arrival cost for the samples before it.

The unknowns are the parameters and the state at the start of the window (Rao, Rawlings and Mayne 2003). The arrival cost is their normal
distribution, given all earlier samples. At each sample, Gauss-Newton steps minimise the window's residuals plus the arrival cost: one step
in smooth motion (a real-time iteration, Diehl 2001), several where a contact begins. Then a Kalman update adds the oldest sample to the
arrival cost. The derivatives of the motion propagate the arrival cost to the next start of the window.

Readings and states are linearised over the uncertain range of the unknowns (linear.py), from one batch of environments. This is posterior
linearisation (Garcia-Fernandez, Svensson, Morelande and Sarkka 2015).
"""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from stepper.sysid.inertia import Array
from stepper.sysid.linear import Directions, mean_shift
from stepper.sysid.problem import Problem, Sample
from stepper.sysid.rivals import (
    EXCLUDED,
    OTHERS_PER_FRICTION,
    POSSIBLE,
    TWO_SIDED,
    WIDE,
    Verdict,
    other_frictions,
    share_of,
    truncated_normal,
    verdict_of,
    widened,
)
from stepper.sysid.uncertainty import root_of

STEP = 1e-5
"""Smallest half width of finite differences of parameters (in units of their scales) and velocities (m/s, rad/s)."""
POSITION_STEP = 1e-7
"""Smallest half width of finite differences of displacements, m or rad."""
STEPS = 6
"""Largest number of Gauss-Newton steps of the estimate per sample."""
HALVINGS = 4
"""Largest number of halvings of a Gauss-Newton step that increases the cost."""
COST_TOLERANCE = 0.01
"""Largest accepted increase of the cost by a Gauss-Newton step, in squared standard deviations."""
SETTLED_CHANGE = 0.1
"""Largest change of a parameter, in standard deviations, at which the Gauss-Newton steps end."""
SETTLED_STEP = 0.5
"""Largest change of a parameter, in standard deviations, at which the estimate counts as converged although no step lowers the cost.

The change is that by the full Gauss-Newton step.
"""
MAX_CHANGE = 0.5
"""Largest change of a parameter by one Gauss-Newton step, in units of the parameter's scale."""
UNCERTAIN_FRICTION = 0.1
"""Standard deviation of log(friction) before the window above which a new hypothesis is tried.

In this hypothesis, an object sticks that slips at the estimate.
"""
HELD_START = 2.0
"""Difference between the current estimate of log(friction) and the larger value at which the search for a sticking object starts.

With this value the object sticks at the start of the search.
"""
HELD_RANGE = 0.5
"""Half width of the range of log(friction), around the estimate, in which the smallest friction that holds an object is searched.

This friction is close to the estimate, because the same friction force determines both.
"""
SPREAD = 3.0
"""Half width of the range in which parameters other than frictions vary in a search with a sticking object, in standard deviations."""


@dataclass(frozen=True)
class Linear:
    """Predicted readings in a window of recent samples, linearised about an estimate.

    The unknowns are n parameters and the uncertain coordinates of the state at the start of the window. Residuals are (T, width): one row
    for each of the T samples, and the columns of all channels.

    Attributes:
        points: Simulated points in the space of the unknowns, (count, n + states). They are the estimate, points above and below it
            along each direction, and copies of it with other values of friction.
        directions: Directions of the finite differences.
        spans: Widths of local differences above and below the estimate, (n + states, 2).
        made: Predicted states and readings at all points, by name of the attribute of `Stepper`, (count, T, size of the attribute).
        residual: Residuals at all points, (count, T, width), in units of the noise.
        J: Derivatives of the residuals at the estimate, (T, width, n + states).
        expected: Mean of the residuals over the distribution of the unknowns, (T, width).
        noise: Standard deviations of the residuals, (T, width): 1 for the noise, plus the contribution of curvature.
        cost: Sum of the squares of `expected` and of the squared distance of the estimate from the mean before the window, in standard
            deviations.
    """

    points: Array
    directions: Directions
    spans: Array
    made: dict[str, Array]
    residual: Array
    J: Array
    expected: Array
    noise: Array
    cost: float


class Horizon:
    """Moving-horizon estimate of parameters under one hypothesis about frictions (which objects stick and which slip).

    It has a window of recent samples, and a normal distribution of the unknowns from earlier samples (the arrival cost).

    Args:
        problem: Model, parameters and noise.
        mean, cov: Normal distribution of parameters and states before the first sample.
        begin: qpos, qvel and act before the first sample.

    Attributes:
        x: Estimate, (n + states,): parameters theta, then displacements and changes of velocity at the start of the window.
        posterior: Covariance of x.
        evidence: Logarithm of the probability density of all readings, up to a constant.
        settled: Whether the Gauss-Newton steps of the newest sample have converged.
        rival: Point x with another friction that explains the window equally well or better; None if there is none.
        newest: Prediction errors of the newest sample's readings, in units of their noise, (k,).
        normalized_innovation: Normalised innovation squared of the newest sample, per reading: about 1 for a correct model.
        at: Linearisation of the window about the estimate.
    """

    def __init__(self, problem: Problem, mean: Array, cov: Array, begin: tuple[Array, Array, Array]):
        self._problem = problem
        self.x, self._mean, self._cov, self._begin = mean.copy(), mean, cov, begin
        self.x[: problem.n] = np.clip(mean[: problem.n], problem.low, problem.high)
        self.posterior: Array = cov.copy()
        self.evidence = self._past = 0.0
        self.settled, self.rival = False, None
        self.newest, self.normalized_innovation = np.zeros(0), 0.0
        self._holding: list[int] = []
        self._rises: dict[int, Array] = {}
        self._shares: dict[int, float] = {}
        self.at: Linear
        self._bounds = {j: (-math.inf, 0.0) for j in problem.kinked}
        self._samples: deque[Sample] = deque()
        self._now = 0.0

    def copy(self) -> Horizon:
        """Independent copy of this hypothesis.

        The copy and the original can use the same simulated environments, because each sets the state of the environments before use.
        """
        other = copy.copy(self)
        other._samples, other._bounds = copy.copy(self._samples), dict(self._bounds)
        return other

    def branch(self, x: Array) -> Horizon:
        """Copy of this hypothesis, with its estimate computed again on the same window from another initial estimate.

        Args:
            x: Initial estimate, (n + states,): n parameters theta, then displacements and changes of velocity at the start of the window.
        """
        other = self.copy()
        other.x = x.copy()
        other._settle()
        other.newest, other.normalized_innovation = self.newest, self.normalized_innovation
        return other

    def held(self, j: int) -> Horizon | None:
        """Hypothesis in which friction holds an object during the window, with all other unknowns estimated again.

        While the object slips at the estimate, the readings do not depend on the object's mass. So a search that follows derivatives cannot
        find the alternative: a lighter object that is held. The search therefore begins at a friction that is large enough to hold the
        object. Afterwards the distribution of the friction before the window is truncated at the smallest value that the readings allow.

        Args:
            j: Index of the friction in the parameter vector theta.

        Returns:
            The hypothesis; None if the readings exclude it.
        """
        other = self.copy()
        other._mean = self._mean.copy()
        other._mean[j] = min(self.x[j] + HELD_START, self._problem.high[j])
        other.x = self._best_start(j, float(other._mean[j]))
        other._settle()
        if j not in other._holding or other.at.cost > self.at.cost + EXCLUDED:
            return None
        mean, std = float(self._mean[j]), math.sqrt(float(self._cov[j, j]))
        low, high, share = truncated_normal((other._smallest_possible(j, float(self.x[j])) - mean) / std)
        middle, variance = mean + std * (low + high) / 2, (std * (high - low) / (2 * TWO_SIDED)) ** 2
        along = self._cov[:, j] / std**2
        other._mean = self._mean + along * (middle - mean)
        other._cov = self._cov + (variance - std**2) * np.outer(along, along)
        other._past = self._past + math.log(share)
        other.x[j] = middle
        other._settle()
        other.newest, other.normalized_innovation = self.newest, self.normalized_innovation
        return other

    def _best_start(self, j: int, friction: float) -> Array:
        """Start point x, (n + states,), of a search in which the friction with the index j in theta has another value, a logarithm.

        The method simulates points with this value, and returns the point that fits the readings best. In each point one other parameter,
        which is no friction, may be changed too. The reason is that an object that is too heavy stays on the ground, and the derivatives
        with respect to its mass are zero. Changed parameters lie within `SPREAD` standard deviations of their means before the window.
        """
        problem = self._problem
        points = np.tile(self.x, (len(self.at.points), 1))
        points[:, j] = friction
        others = [k for k in range(problem.n) if k not in problem.kinked]
        for rows, k in zip(np.array_split(np.arange(1, len(points)), len(others)), others, strict=True):
            std = math.sqrt(self._cov[k, k])
            points[rows, k] = np.clip(self._mean[k] + SPREAD * std * np.linspace(-1, 1, len(rows)), problem.low[k], problem.high[k])
        _, residual = problem.predict(self._begin, points, list(self._samples), self._now)
        offset = points - self._mean
        offset[:, j] = 0.0
        apart = np.linalg.solve(root_of(self._cov), offset.T)
        return np.asarray(points[int(((residual**2).sum(axis=(1, 2)) + (apart**2).sum(axis=0)).argmin())])

    def _smallest_possible(self, j: int, about: float) -> float:
        """Smallest value of the friction j that the readings in the window allow, if all other unknowns have their estimates.

        The search takes place near the value `about`. Both values are logarithms.
        """
        points = np.tile(self.x, (len(self.at.points), 1))
        points[:, j] = np.linspace(about + HELD_RANGE, about - HELD_RANGE, len(points))
        _, residual = self._problem.predict(self._begin, points, list(self._samples), self._now)
        slips = (residual**2).sum(axis=(1, 2)) > (self.at.residual[0] ** 2).sum() + POSSIBLE
        return float(points[max(int(slips.argmax()) - 1, 0) if slips.any() else -1, j])

    def absorb(self, evidence: float) -> None:
        """Adds the evidence of a similar hypothesis, which is then dropped, to the evidence of this one.

        Args:
            evidence: Attribute `evidence` of the similar hypothesis, a logarithm.
        """
        more = float(np.logaddexp(self.evidence, evidence)) - self.evidence
        self._past, self.evidence = self._past + more, self.evidence + more

    def take(self, sample: Sample) -> None:
        """Adds a sample (controls and readings) to the window, and updates the estimate."""
        self._samples.append(sample)
        self._now += self._problem.period
        self._settle()

    def worth_trying_held(self) -> list[int]:
        """Indices of the frictions for which a hypothesis with a sticking object should be tried.

        At the estimate the object slips, and the friction was uncertain before the window. The list is empty if no parameter other than
        frictions was uncertain before the window.
        """
        problem, std = self._problem, np.sqrt(np.diag(self._cov))
        if not any(std[k] > WIDE * problem.scale[k] for k in range(problem.n) if k not in problem.kinked):
            return []
        return [j for j in problem.kinked if j not in self._holding and std[j] > UNCERTAIN_FRICTION]

    def holds(self, j: int) -> bool:
        """Whether the friction with index `j` in theta holds its object at the estimate, so that the object sticks."""
        return j in self._holding

    def leave(self) -> None:
        """Removes the oldest sample from a full window, and adds its information to the distribution of the unknowns before the window."""
        if len(self._samples) == self._problem.length:
            self._advance(self.at)

    def low(self) -> Array:
        """Lower bounds of the parameters theta, (n,), raised where the readings exclude small frictions."""
        return np.maximum(self._problem.low, [self._bound(j) for j in range(self._problem.n)])

    def _points(self) -> tuple[Array, Directions, Array]:
        """Vectors of unknowns to simulate, for derivatives at the estimate and for comparisons of the estimated frictions with others.

        Returns:
            points: Vectors, (count, n + states): the estimate, vectors above and below it, and vectors with other values of friction.
            directions: Directions of the finite differences.
            spans: Distances from the estimate to the vectors above and below it along each coordinate, (n + states, 2).
        """
        problem, m, n = self._problem, len(self._problem.dofs), self._problem.n
        h = np.concatenate([STEP * problem.scale, np.full(m, POSITION_STEP), np.full(m, STEP)])
        clearance = np.full(len(h), math.inf)
        clearance[:n] = np.minimum(problem.high - self.x[:n], self.x[:n] - problem.low)
        std = np.sqrt(np.diag(self.posterior))[:n]
        directions = Directions(self.posterior, h, clearance, np.flatnonzero(std > WIDE * problem.scale).tolist(), problem.kinked)
        first = 1 + 2 * len(h)
        points = np.tile(self.x, (first + OTHERS_PER_FRICTION * len(problem.kinked), 1))
        points[1:first] = directions.points(self.x)
        for k, j in enumerate(problem.kinked):
            bound = self._bound(j)
            rows = slice(first + k * OTHERS_PER_FRICTION, first + (k + 1) * OTHERS_PER_FRICTION)
            points[rows, j] = np.clip(other_frictions(self.x[j], std[j], bound), max(problem.low[j], bound), problem.high[j])
        # At a bound, one of the two differences has no width, because predictions are made within bounds only.
        spans = np.stack([h, h], axis=1)
        for j in range(n):
            spans[j] = min(self.x[j] + h[j], problem.high[j]) - self.x[j], self.x[j] - max(self.x[j] - h[j], problem.low[j])
        return points, directions, spans

    def _compare(self, at: Linear) -> Verdict:
        """Compares the estimate with other values of friction, and raises lower bounds of frictions to values that the readings exclude."""
        problem = self._problem
        unknown = [bool(self._cov[j, j] > (WIDE * problem.scale[j]) ** 2) for j in problem.kinked]
        verdict = verdict_of(
            problem.kinked,
            unknown,
            points=at.points,
            residual=at.residual,
            J=at.J,
            mean=self._mean,
            root=root_of(self._cov),
            first=1 + 2 * len(self.x),
        )
        for j, value in verdict.excluded.items():
            if value > self._bound(j):
                self._bounds[j] = value, self._now
        return verdict

    def _bound(self, j: int) -> float:
        """Largest value of a friction that the readings exclude, as a logarithm; -inf if they exclude none.

        The value decreases with time, because friction may drift. `j` is the index of the friction in theta.
        """
        if j not in self._bounds:
            return -math.inf
        value, when = self._bounds[j]
        return value - 3 * float(self._problem.drift[j]) * math.sqrt(max(self._now - when, 0.0))

    def _settle(self) -> None:
        """Improves the estimate by Gauss-Newton steps until a step is small compared with the standard deviations of the parameters.

        In smooth motion one step suffices. Where a contact begins, the derivatives and the covariance change with the estimate, so that
        several steps are needed. Without a budget of predictions for another step, the estimate is not settled.
        """
        n, budget = self._problem.n, self._problem.budget
        best, self.rival = self._linear(), None
        self._expect(best)
        for _ in range(STEPS):
            holding = self._hold(best)
            step, self.posterior = self._gauss_newton(best)
            moved = np.abs(step[:n]) > SETTLED_CHANGE * np.sqrt(np.diag(self.posterior))[:n]
            moved[holding] = False
            if not moved.any():
                self._move(best.points[0], step)
                self.at, self.settled = best, True
                return
            if budget.left <= 0:
                break
            share = 1.0
            for _ in range(min(HALVINGS, budget.left)):
                self._move(best.points[0], share * step)
                shorter = self._linear()
                if shorter.cost <= best.cost + COST_TOLERANCE:
                    break
                share /= 2
            else:
                # No step lowers the cost, because the cost has kinks, as at the onset of slip. The estimate is settled if the step is
                # short.
                self.x = best.points[0].copy()
                far = np.abs(step[:n]) > SETTLED_STEP * np.sqrt(np.diag(self.posterior))[:n]
                far[holding] = False
                self.at, self.settled = best, not far.any()
                return
            best = shorter
        self.x = best.points[0].copy()
        self._hold(best)
        _, self.posterior = self._gauss_newton(best)
        self.at, self.settled = best, False

    def _hold(self, at: Linear) -> list[int]:
        """Sets to zero the derivatives with respect to frictions at which objects stick, in place, and returns these frictions' indices.

        It also stores the first rival of this sample: a point with another friction that explains the window equally well or better.
        """
        verdict = self._compare(at)
        if self.rival is None and verdict.rival is not None:
            self.rival = at.points[verdict.rival].copy()
        self._holding, self._rises = verdict.holding, verdict.rises
        at.J[..., verdict.holding] = 0.0
        return verdict.holding

    def _expect(self, at: Linear) -> None:
        """Sets `newest` (prediction errors of the newest sample's readings, in units of their noise) and `normalized_innovation`.

        Args:
            at: Linearisation of a window that includes this sample, about the estimate before this sample.
        """
        seen = self._problem.seen(self._samples[-1][1])
        self.newest, J = at.expected[-1][seen], at.J[-1][seen]
        self.normalized_innovation = 0.0
        if len(self.newest):
            expected = J @ self.posterior @ J.T + np.diag(at.noise[-1][seen] ** 2)
            self.normalized_innovation = float(self.newest @ np.linalg.solve(expected, self.newest)) / len(self.newest)

    def _linear(self) -> Linear:
        """Linearisation of the predicted readings in the window of recent samples, about the current estimate."""
        points, directions, spans = self._points()
        made, residual = self._problem.predict(self._begin, points, list(self._samples), self._now)
        J, curved = directions.derivative(residual[: 1 + 2 * len(self.x)], spans)
        noise = np.sqrt(1 + (curved**2).sum(axis=0))
        apart = np.linalg.solve(root_of(self._cov), self.x - self._mean)
        expected = residual[0] + mean_shift(curved)
        cost = float((expected**2).sum() + (apart**2).sum())
        return Linear(points, directions, spans, made, residual, J.transpose(1, 2, 0).copy(), expected, noise, cost)

    def _gauss_newton(self, at: Linear) -> tuple[Array, Array]:
        """Gauss-Newton step, (n + states,), on the squared residuals of the window plus the arrival cost, and the posterior covariance.

        The arrival cost is the normal distribution of the unknowns before the window. The method also sets `evidence`, the logarithm of the
        probability density of all readings, up to a constant.
        """
        N = len(self.x)
        root = root_of(self._cov)
        rows = np.concatenate([(at.J / at.noise[..., None]).reshape(-1, N), np.linalg.solve(root, np.eye(N))])
        left = np.concatenate([(at.expected / at.noise).ravel(), np.linalg.solve(root, at.points[0] - self._mean)])
        # Columns are scaled, because their sizes differ by many orders of magnitude.
        size = np.linalg.norm(rows, axis=0)
        step = -np.linalg.lstsq(rows / size, left, rcond=None)[0]
        remaining = float(((left + (rows / size) @ step) ** 2).sum())
        least = step / size
        step = least * min(1.0, MAX_CHANGE / max(float((np.abs(least[: self._problem.n]) / self._problem.scale).max()), 1e-300))
        information = (rows / size).T @ (rows / size)
        inverse = np.linalg.inv(information) / np.outer(size, size)
        # Laplace's approximation of the evidence has two terms: the cost, and the ratio of the volumes of posterior and prior.
        narrowed = np.linalg.slogdet(information)[1] / 2 + np.log(size).sum() + np.log(np.diag(root)).sum()
        self._shares = {}
        for j, rises in self._rises.items():
            before, after = float(self._cov[j, j]), float(inverse[j, j])
            self._shares[j] = share_of(rises, float(least[j]), before=before, after=after)
            inverse = widened(inverse, j, before, self._shares[j])
            narrowed -= np.log(inverse[j, j] / after) / 2
        self.evidence = self._past - remaining / 2 - float(np.log(at.noise).sum() + narrowed)
        return step, np.asarray((inverse + inverse.T) / 2)

    def _move(self, start: Array, step: Array) -> None:
        """Sets the estimate to start + step, (n + states,) each, with parameters clipped to their bounds."""
        n = self._problem.n
        self.x = start + step
        self.x[:n] = np.clip(self.x[:n], self.low(), self._problem.high)

    def _advance(self, at: Linear) -> None:
        """Moves the oldest sample from the window to the arrival cost, by a Kalman update.

        The arrival cost is the normal distribution of the unknowns before the window. The method then propagates it to the new start of the
        window.
        """
        problem, N, m, n = self._problem, len(self.x), len(self._problem.dofs), self._problem.n
        linearized, J, residual = at.points[0], at.J[0] / at.noise[0][:, None], at.expected[0] / at.noise[0]
        expected = J @ self._cov @ J.T + np.eye(len(J))
        gain = np.linalg.solve(expected, J @ self._cov).T
        innovation = residual + J @ (self._mean - linearized)
        spread = np.linalg.slogdet(expected)[1] / 2 + np.log(at.noise[0]).sum()
        self._past -= float(innovation @ np.linalg.solve(expected, innovation) / 2 + spread)
        mean = self._mean - gain @ innovation
        keep = np.eye(N) - gain @ J
        cov = keep @ self._cov @ keep.T + gain @ gain.T
        for j, share in self._shares.items():
            cov = widened(cov, j, float(self._cov[j, j]), share)
        qpos, qvel = at.made["qpos"][0], at.made["qvel"][0]
        moved = problem.model.differentiate_pos(np.tile(qpos[0], (2 * N, 1)), qpos[1 : 1 + 2 * N])[:, problem.dofs]
        states = np.concatenate([moved, (qvel[1 : 1 + 2 * N] - qvel[0])[:, problem.dofs]], axis=1)
        states = np.concatenate([np.zeros((1, 2 * m)), states])
        slope, curved = at.directions.derivative(states[:, None], at.spans)
        F = np.eye(N)
        F[n:] = slope[:, 0].T
        F[n:, self._holding] = 0.0
        self._mean = np.concatenate([mean[:n], F[n:] @ (mean - linearized)])
        self._mean[n:] += mean_shift(curved)[0]
        self.x = np.concatenate([self.x[:n], F[n:] @ (self.x - linearized)])
        # Coordinates that contacts hold exactly get a small variance, so that the covariance has an inverse.
        gained = np.diag(problem.gained**2 + np.concatenate([np.zeros(n), np.full(2 * m, (1e-3 * POSITION_STEP) ** 2)]))
        gained[n:, n:] += curved[:, 0].T @ curved[:, 0]
        cov, posterior = (F @ what @ F.T + gained for what in (cov, self.posterior))
        self._cov, self.posterior = (cov + cov.T) / 2, (posterior + posterior.T) / 2
        self._begin = qpos[0].copy(), qvel[0].copy(), at.made["act"][0, 0].copy()
        self._samples.popleft()
