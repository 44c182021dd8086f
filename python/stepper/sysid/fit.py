"""Offline identification (`stepper.sysid.identify`): parameters of a model from measurements, with their uncertainty.

The optimiser varies the vector x: first the parameter vector theta, divided by its scales (`Block.scale`), then the uncertain coordinates
of the initial states. Theta has the logarithms of positive quantities, with a scale of 1.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stepper._options import Options
from stepper._stepper import Model
from stepper.actuators import ActuatorModel
from stepper.shared.arguments import check_mapping, check_number, check_whole
from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, silent
from stepper.sysid.combinations import combinations_of
from stepper.sysid.data import Data, episodes_of
from stepper.sysid.inertia import Array
from stepper.sysid.minima import starts_around
from stepper.sysid.nullspace import EQUAL_FIT, FLAT_EXCESS, FLAT_STD, SIGNIFICANT, FlatSet, cost_ratio
from stepper.sysid.parameters import Block, FitParameter, bind, natural, value_slopes, write
from stepper.sysid.residuals import Linearized, Residuals, Together
from stepper.sysid.result import Identification, Search, t_quantile
from stepper.sysid.shift import EARLY, FREED_STD, LATE, RATIO, finding_of_fit, suspicious
from stepper.sysid.simulate import Simulator, noise_of, solved
from stepper.sysid.uncertainty import outside_null_space, undetermined, warnings_of

SAME_MINIMUM = 1e-2
"""Distance between the ends of two searches below which they count as the same minimum, in units of the parameters' scales."""
ABANDON_RATIO = 9.0
"""Ratio of a search's cost to the lowest cost, above which the search is abandoned. At 9, residuals are three times as large."""
ATTRACTION, CLOSE = 0.2, 0.1
"""A search counts as reaching a known minimum if a Gauss-Newton step leads there, which spares its last evaluations.

The step's end is closer than `CLOSE`, in units of the scales, and the distance is less than `ATTRACTION` times that before the step.
Without `CLOSE`, the other order of two springs with stiffnesses of a ratio of 1.3 was missed in 1 of 12 runs.
"""
HOPELESS = 1e-3
"""Relative decrease of the cost by a Gauss-Newton step, below which a search with a cost above `ABANDON_RATIO` ends.

At 1e-2, the other order of two springs with a ratio of 12 was missed in 4 of 24 runs, at 1e-3 in 1.
"""
OTHER_STARTS = 10
"""Number of searches for other minima. Two masses of a pendulum with a ratio of 2: with 8, 2 of 48 runs missed the other one."""
BETTER = 3
"""Largest number of times that other minima are searched. Noise and searches are repeated if one of these is better than the estimate."""
COARSE, FINE = 1e-4, 1e-4
"""Relative change of the unknowns below which a search ends: `COARSE` for all searches except the last, `COARSE * FINE` for the last."""
NOISE_TOLERANCE = 0.05
"""Relative change of the estimated noise below which the iteration of the noise ends."""
MIN_NOISE = 1e-6
"""Lower bound of an estimated noise, divided by the channel's largest reading.

The bound covers errors of time steps and finite differences.
"""


def identify(
    model: Model,
    data: Data,
    parameters: Sequence[FitParameter | str],
    *,
    options: Options | None = None,
    actuators: ActuatorModel | None = None,
    noise: Mapping[str, ArrayLike] | None = None,
    starts: int = 4,
    step: float = 1e-5,
    max_evaluations: int = 50,
    threads: int = 0,
    seed: int = 0,
    channels: Sequence[str] | None = None,
    columns: Mapping[str, str] | None = None,
    start: str | tuple[ArrayLike, ArrayLike] | None = None,
    progress: ProgressCallback | None = None,
) -> Identification:
    """Identifies parameters of a model from measurements, with their uncertainty.

    SciPy's `least_squares` (trust-region reflective) minimises the residuals divided by their noise, within bounds, from several starts at
    once. One batch simulates all episodes, starts, and the displaced parameters for central differences.

    Further searches look for other estimates that explain the readings as well. Values that differ between these are not determined.

    Args:
        model: Model with the known parameters.
        data: Measurements: `Episode`s, paths of recordings, CSV or npz files, or several of these.
        parameters: Unknown parameters: `FitParameter`s, or texts like "body_mass[box]" and "geom_friction[floor,box][0]=0.1..2".
        options: Options of the step; None selects hard contact. The default tolerance is 1e-9 m/s.
        actuators: Actuator model of the robot, with the known attributes of its drives.
        noise: Standard deviations of channels by name, each a number or (dim,), in the channel's unit. The noise of other channels is
            estimated from the residuals.
        starts: Number of first searches. One starts at the start values of the parameters (`FitParameter.start`, by default the model's
            values). The others start at points of a Sobol sequence around these values that fit the first part of the data best.
        step: Half width of the finite differences, relative for positive quantities. It is small, because a contact that closes one sample
            earlier causes a jump, which a wide difference would count as a derivative.
        max_evaluations: Largest number of evaluations per search.
        threads: Number of threads; 0 uses all cores.
        seed: Seed of the Sobol sequences of start points.
        channels: Names of the channels to use from files. None selects all sensors of a recording, and all channels of a log.
        columns: New names of columns of files, by heading: {"Fx [N]": "wrist_force[0]"}.
        start: Initial state of logs whose first row does not have it: name of a keyframe, or (qpos, qvel), m, rad, m/s and rad/s.
        progress: Progress callback, called with the name of a search and the used fraction of its evaluations. Most searches end early.

    Returns:
        Estimate and distribution of the parameters. `print` shows it as a table; `Identification.sample` draws parameters for
        `Stepper.randomize`.

    Raises:
        TypeError: An argument has another type.
        KeyError: A channel is neither a sensor nor a coordinate of the model.
        ValueError: A parameter is invalid, or the data do not match the model; the message has the file or episode.
        MissingPackageError: SciPy is not installed.
    """
    optimize = require("scipy.optimize", "to identify parameters")
    qmc = require("scipy.stats.qmc", "to identify parameters")
    for name, count in (("starts", starts), ("max_evaluations", max_evaluations)):
        check_whole(name, count, least=1)
    check_number("step", step, above=0.0)
    check_whole("seed", seed, least=0)
    if noise is not None:
        check_mapping("noise", noise, '{"wrist_force": 0.3}')
    if progress is not None and not callable(progress):
        raise TypeError(f"progress is {progress!r}, must be a function of a text and a fraction, or None")
    began = time.perf_counter()
    blocks = bind(parameters, model)
    episodes = episodes_of(data, model, channels=channels, columns=columns, start=start)
    simulator = Simulator(
        _with_start_values(model, blocks), episodes, blocks, solved(options or Options()), threads=threads, actuators=actuators
    )
    residuals = Residuals(simulator, step)
    if residuals.count <= residuals.n:
        raise ValueError(f"{residuals.count} readings cannot determine {residuals.n} numbers; give more data or fewer parameters")
    known = _given_noise(simulator, noise or {})
    first = _first_noise(simulator)
    residuals.sigma = np.where(np.isnan(known), first, known)
    solver = _Solver(optimize, residuals, most=max_evaluations, progress=progress or silent)
    near = starts_around(qmc, residuals, residuals.start, starts - 1, seed, first=True)
    searches = solver.search([residuals.start, *near])
    for attempt in range(BETTER):
        searches = _with_noise(solver, residuals, searches, known)
        best, likely = min(searches, key=lambda s: s.cost), cost_ratio(residuals, SIGNIFICANT)
        far = starts_around(qmc, residuals, best.x, OTHER_STARTS, seed + 1 + attempt)
        searches += solver.search(far, known=_distinct(searches, likely))
        if min(s.cost for s in searches) * cost_ratio(residuals, EQUAL_FIT) >= best.cost:
            break
    lowest, *ends = _distinct(searches, likely)
    minima = [lowest, *(found for found in ends if found.is_minimum(residuals.low, residuals.high))]
    # Of minima that explain the readings equally well, the nearest to the start values is the estimate.
    nearest = min(
        (found for found in minima if found.cost <= cost_ratio(residuals, EQUAL_FIT) * lowest.cost),
        key=lambda found: float(np.linalg.norm((found.x - residuals.start)[: residuals.n])),
    )
    (best,) = solver.search([nearest.x], COARSE * FINE)
    rivals = [found for found in minima if found is not nearest and not best.explains(found.x, found.at)]
    others = sorted((found for found in searches if found is not nearest and found not in rivals), key=lambda s: s.cost)
    return _concluded(model, residuals, [best, *rivals], others, solver, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Found:
    """End of a search for the least-squares estimate.

    Attributes:
        x: Vector of unknowns at the end, (n + starts,).
        cost: Half the sum of the squares of all residuals at x.
        at: Residuals and Jacobian at x.
        converged: Whether the search converged.
    """

    x: Array
    cost: float
    at: Linearized
    converged: bool

    def explains(self, x: Array, at: Linearized) -> bool:
        """Whether the linear model at this end predicts the readings at another point, so that both belong to one minimum.

        Args:
            x: The other point, (n + starts,).
            at: Residuals there.
        """
        missed = at.residual - self.at.residual - self.at.jacobian @ (x - self.x)
        return float((missed**2).sum()) < EQUAL_FIT * 2 * self.cost / self.at.data

    def attracts(self, x: Array, step: Array) -> bool:
        """Whether a Gauss-Newton step, (n + starts,), from another point x leads to this end."""
        before, after = (float(np.abs(point - self.x).max()) for point in (x, x + step))
        return after < min(CLOSE, ATTRACTION * before)

    def is_minimum(self, low: Array, high: Array) -> bool:
        """Whether the search converged, or a Gauss-Newton step within the bounds would hardly decrease the cost.

        Other searches ran out of evaluations on the slope of a curved valley.
        """
        step = np.clip(self.x + _gauss_newton(self.at), low, high) - self.x
        gain = float((self.at.residual**2).sum() - ((self.at.residual + self.at.jacobian @ step) ** 2).sum())
        return self.converged or gain < FLAT_EXCESS * 2 * self.cost / self.at.data


def _gauss_newton(at: Linearized) -> Array:
    """Gauss-Newton step along the directions that the data determine, (n + starts,).

    It is of the normal equations, because LAPACK's threads slow down singular value decompositions in concurrent searches.
    """
    squares, axes = np.linalg.eigh(at.jacobian.T @ at.jacobian)
    sure = squares > FLAT_STD**-2
    return np.asarray(-(axes[:, sure] / squares[sure]) @ (axes[:, sure].T @ (at.jacobian.T @ at.residual)))


class _LeftOutError(Exception):
    """Ends a search that finds no other minimum: see `_Solver.search`."""


class _Solver:
    """Solver that runs several least-squares searches concurrently. Each batch of environments evaluates the next point of every search.

    Args:
        optimize: Module `scipy.optimize`.
        residuals: Residuals to minimise.
        most: Largest number of points that each search evaluates.
        progress: Progress callback, called with a text and the completed fraction.

    Attributes:
        evaluations: Number of evaluated points so far.
    """

    def __init__(self, optimize: Any, residuals: Residuals, *, most: int, progress: ProgressCallback):
        self._optimize, self._residuals, self._most = optimize, residuals, most
        self._report, self._searches = progress, 0
        self.evaluations = 0

    def with_residuals(self, residuals: Residuals) -> _Solver:
        """New solver for other residuals, with the settings of this solver. Its count of evaluations starts at 0."""
        return _Solver(self._optimize, residuals, most=self._most, progress=self._report)

    def search(self, starts: Sequence[Array], tolerance: float = COARSE, known: Sequence[_Found] = ()) -> list[_Found]:
        """Runs least-squares searches concurrently, one from each start point, and returns where they ended, in the same order.

        Args:
            starts: Start points x, (n + starts,) each: n parameters in units of their scales, then uncertain initial coordinates. There may
                be none.
            tolerance: Relative change of x below which a search ends.
            known: Known minima. If there are any, searches use one-sided differences. Those that reach one of these, or end high above
                them, are left out. So are those that reach parameters with which the simulation diverges.
        """
        together = Together(self._residuals, len(starts), sides=1 if known else 2)
        self._searches += 1
        before = self.evaluations
        name = f"search {self._searches}"

        def at_each(x: Array, at: Linearized) -> None:
            """Reports the number of evaluations as a fraction of the largest number, and may end a search for other minima."""
            self._report(name, min(1.0, (self.evaluations - before) / (len(starts) * self._most)))
            if known and (not np.isfinite(at.residual).all() or self._in_vain(x, at, known)):
                raise _LeftOutError

        with ThreadPoolExecutor(max(len(starts), 1)) as pool:
            try:
                ends = list(pool.map(lambda k: self._search_from(together, k, starts[k], tolerance, at_each), range(len(starts))))
            except BaseException:  # Only the main thread receives Ctrl-C, and must stop the searches.
                together.stop()
                raise
        self._report(name, 1.0)
        return [found for found in ends if found is not None]

    def _in_vain(self, x: Array, at: Linearized, known: Sequence[_Found]) -> bool:
        """Whether a search at a point x, (n + starts,), would end at a known minimum, or high above it."""
        if any(found.explains(x, at) for found in known):
            return True
        if not np.isfinite(at.jacobian).all():
            return False
        step = _gauss_newton(at)
        cost, left = (float((r**2).sum()) / 2 for r in (at.residual, at.residual + at.jacobian @ step))
        hopeless = left > max((1 - HOPELESS) * cost, ABANDON_RATIO * min(found.cost for found in known))
        return hopeless or any(found.attracts(x, step) for found in known)

    def _search_from(
        self, together: Together, search: int, x0: Array, tolerance: float, at_each: Callable[[Array, Linearized], None]
    ) -> _Found | None:
        """Runs a least-squares search from one start point, (n + starts,), in a thread. The result is None if it is left out.

        The search ends if the relative change of x is below `tolerance`. `at_each` is called after each evaluation, and may raise
        `_LeftOutError` to end it.
        """
        held: dict[bytes, Linearized] = {}

        def at(x: Array) -> Linearized:
            key = x.tobytes()
            if key not in held:
                while len(held) >= 4:  # The optimiser returns only to its trial point and its present point.
                    held.pop(next(iter(held)))
                held[key] = together.ask(search, x.copy())
                self.evaluations += 1
                at_each(x, held[key])
            return held[key]

        low, high = self._residuals.low, self._residuals.high
        try:
            found = self._optimize.least_squares(
                lambda x: at(x).residual, np.clip(x0, low, high), lambda x: at(x).jacobian, bounds=(low, high), method="trf", x_scale="jac",
                ftol=tolerance**1.5, xtol=tolerance, gtol=1e-10, max_nfev=self._most,
            )  # fmt: skip
            return _Found(found.x, float(found.cost), at(found.x), found.status > 0)
        except _LeftOutError:
            return None
        finally:
            together.leave()


def _with_noise(solver: _Solver, residuals: Residuals, searches: list[_Found], known: Array) -> list[_Found]:
    """Ends of searches with the noise that the residuals of the best search have. The noise is written to `residuals`.

    `known` has the standard deviation of the noise of each column of the readings, (width,); NaN where it is estimated.
    """
    for _ in range(5):
        best = min(searches, key=lambda s: s.cost)
        sigma = np.where(np.isnan(known), _noise_left(residuals, best.at), known)
        settled = (np.abs(sigma - residuals.sigma) <= NOISE_TOLERANCE * residuals.sigma).all()
        residuals.sigma = sigma
        # The noise determines the weights of the channels. After a change of the noise, another minimum may be the lowest.
        searches = solver.search([found.x for found in _distinct(searches)])
        if settled:
            break
    return searches


def _distinct(searches: Sequence[_Found], ratio: float = ABANDON_RATIO) -> list[_Found]:
    """Ends of searches whose cost is at most `ratio` times the lowest, one of each minimum, in ascending order of cost."""
    out: list[_Found] = []
    least = min(s.cost for s in searches)
    for found in sorted(searches, key=lambda s: s.cost):
        same = any(np.abs(found.x - other.x).max() <= SAME_MINIMUM or other.explains(found.x, found.at) for other in out)
        if found.cost <= ratio * least and not same:
            out.append(found)
    return out


def _with_start_values(model: Model, blocks: list[Block]) -> Model:
    """Copy of a model with the start values of the parameters, so that features such as dry friction exist in it."""
    theta = np.concatenate([block.start for block in blocks])[None]
    fields = write(blocks, theta, model).fields
    return model.replace(**{name: array[0] for name, array in fields.items()}) if fields else model


def _given_noise(simulator: Simulator, noise: Mapping[str, ArrayLike]) -> Array:
    """Standard deviation of the noise of each column of the readings, (width,), as given to `identify`; NaN without a value."""
    known = np.full(simulator.width, np.nan)
    channels = {channel.name: channel for channel in simulator.channels}
    for name, given in noise.items():
        if name not in channels:
            raise ValueError(f"noise has {name!r}, which is no channel of the data; there are: {', '.join(channels)}")
        known[channels[name].lines] = noise_of(channels[name], given)
    return known


def _first_noise(simulator: Simulator) -> Array:
    """First guess of the noise of each column of the readings, (width,): the standard deviation of the readings."""
    sigma = np.ones(simulator.width)
    for channel in simulator.channels:
        rows = np.concatenate([np.asarray(e.readings[channel.name]) for e in simulator.episodes if channel.name in e.readings])
        scatter = np.nanstd(rows, axis=0) if np.isfinite(rows).any() else np.ones(rows.shape[1])
        scatter = np.nan_to_num(scatter)
        whole = max(float(scatter.max()), 1e-3 * float(np.nan_to_num(np.abs(rows)).max()), 1e-9)
        size = channel.lines.stop - channel.lines.start
        sigma[channel.lines] = np.maximum(scatter, 0.01 * whole) if size == len(scatter) else whole
    return sigma


def _noise_left(residuals: Residuals, at: Linearized) -> Array:
    """Estimate of the noise of each column of the readings, (width,), from the residuals of a fit.

    It is the root mean square of the residuals, corrected for the number of parameters.
    """
    simulator = residuals.simulator
    rows = np.concatenate(residuals.whitened(at)) * residuals.sigma
    sigma = residuals.sigma.copy()
    free = residuals.count / max(residuals.count - residuals.n, 1)
    for channel in simulator.channels:
        largest = max(
            float(np.nan_to_num(np.abs(np.asarray(e.readings[channel.name]))).max())
            for e in simulator.episodes
            if channel.name in e.readings
        )
        for j in range(channel.lines.start, channel.lines.stop):
            column = rows[np.isfinite(rows[:, j]), j]
            if len(column) > 1:
                sigma[j] = max(float(np.sqrt(np.mean(column**2) * free)), MIN_NOISE * largest, 1e-12)
    return sigma


def _concluded(
    model: Model, residuals: Residuals, minima: list[_Found], others: list[_Found], solver: _Solver, *, seconds: float
) -> Identification:
    """Result of an identification: estimate, covariance, warnings and statistics.

    `minima` has the estimate, then minima that are not significantly worse; `others` has the ends of the other searches.
    """
    n, simulator = residuals.n, residuals.simulator
    best, *rivals = minima
    flat = FlatSet(residuals, best.x, best.at, [rival.x for rival in rivals])
    first = flat.points[0]
    if first.x is not best.x:
        best = replace(best, x=first.x, at=first.at, converged=True)
    span = (residuals.high - residuals.low)[:n] / 2
    reach = np.where(np.isfinite(span), span, 100.0)
    sure = outside_null_space(best.at.jacobian, best.at.residual, residuals.reading_indices(), reach, first.null)
    theta, scale = best.x[:n] * residuals.scale, residuals.scale
    covariance = (sure.covariance + flat.widening) * np.outer(scale, scale)
    values = np.stack([natural(residuals.blocks, point.x[:n] * scale) for point in flat.points])
    slopes = np.stack([value_slopes(residuals.blocks, point.x[:n] * scale) * scale for point in flat.points])
    std = np.sqrt(np.einsum("ij,jk,ik->i", slopes[0], sure.covariance + flat.widening, slopes[0]))
    known = ~(
        flat.undetermined(values, slopes, std)
        | undetermined(residuals.blocks, std / np.maximum(np.linalg.norm(slopes[0], axis=1), 1e-300), reach)
    )
    freedom = max(residuals.count - residuals.n, 1)
    together = combinations_of(
        residuals.blocks, model, flat, scale=scale, covariance=covariance, known=known, quantile=t_quantile(0.95, freedom)
    )
    found = Identification(
        model=model,
        parameters=tuple(block.parameter for block in residuals.blocks),
        theta=theta,
        covariance=covariance,
        scale=scale,
        determined=known,
        combinations=together,
        freedom=freedom,
        noise=_by_channel(simulator, residuals.sigma),
        residual=_by_channel(simulator, residuals.sigma * _rms(residuals, best.at)),
        searches=tuple(Search(s.x[:n] * scale, s.cost, s.converged) for s in (best, *rivals, *others)),
        evaluations=solver.evaluations,
        steps=simulator.steps,
        seconds=seconds,
        warnings=(),
    )
    shifts = _shift_warnings(residuals, best, solver)
    findings = warnings_of(residuals, found, sure, slopes=slopes[0], first=first, converged=best.converged)
    return replace(found, warnings=(*shifts, *findings))


def _shift_warnings(residuals: Residuals, best: _Found, solver: _Solver) -> tuple[str, ...]:
    """Warnings about readings that fit better if they are shifted one sample earlier or later."""
    if not suspicious(residuals.whitened(best.at)):
        return ()
    tried = []
    for shift in (LATE, EARLY):
        other = residuals.shifted(shift)
        if other.count > other.n:
            found = min(solver.with_residuals(other).search([best.x, residuals.start]), key=lambda s: s.cost)
            tried.append((found.cost / other.count / max(best.cost / residuals.count, 1e-300), shift))
    ratio, shift = min(tried, default=(1.0, 0))
    return (finding_of_fit(shift, ratio, _freed_ratio(residuals, best, solver)),) if ratio < RATIO else ()


def _freed_ratio(residuals: Residuals, best: _Found, solver: _Solver) -> float | None:
    """Mean square residual of a new fit that also estimates the initial states, divided by the mean square residual of the given fit.

    The result is None if the given fit already estimates the initial state of every episode, and NaN if there are too few readings.
    """
    other = residuals.freed(FREED_STD)
    if other is None:
        return None
    if other.count <= other.n:
        return np.nan
    # One search starts from the best parameters and one from the start values, both without displacements of the initial states.
    points = [np.concatenate([x[: other.n], other.start[other.n :]]) for x in (best.x, residuals.start)]
    found = min(solver.with_residuals(other).search(points), key=lambda s: s.cost)
    return found.cost / max(best.cost, 1e-300)


def _rms(residuals: Residuals, at: Linearized) -> Array:
    """Root mean square of the residuals of each column of the readings, in units of the column's noise, (width,)."""
    rows = np.concatenate(residuals.whitened(at))
    counts = np.isfinite(rows).sum(axis=0)
    return np.asarray(np.sqrt(np.nansum(rows**2, axis=0) / np.maximum(counts, 1)))


def _by_channel(simulator: Simulator, values: Array) -> dict[str, list[float]]:
    """Numbers of each channel's columns, by name of the channel. `values` has the numbers of all columns of the readings, (width,)."""
    return {channel.name: [float(v) for v in values[channel.lines]] for channel in simulator.channels}
