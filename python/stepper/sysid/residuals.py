"""Residuals, which are (prediction - reading) / noise, and their Jacobian, for the points of several searches in one batch."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stepper.sysid.data import Episode
from stepper.sysid.inertia import Array
from stepper.sysid.shift import shifted
from stepper.sysid.simulate import Simulator

JUMP = 0.5
"""Largest ratio for a smooth reading: difference of its one-sided derivatives at a point, divided by the larger of them.

Above this ratio, the reading is assumed to jump on one side of the point.
"""


@dataclass(frozen=True)
class Linearized:
    """Residuals of measurements, priors and initial states at a point x of the unknowns, with their Jacobian.

    Attributes:
        residual: Residuals, (m,): measured readings by episode and row, then priors, then displacements of initial states.
        jacobian: Derivatives of the residuals with respect to x, (m, n + starts).
        data: Number of residuals of readings.
    """

    residual: Array
    jacobian: Array
    data: int


class Residuals:
    """Weighted residuals of predicted sensor readings and of priors, as a function of the unknowns x.

    A residual is (prediction - reading) / noise. The vector x, (n + starts,), is dimensionless. It begins with the n numbers of the
    parameter vector theta, divided by their scales (`Block.scale`). Then come the uncertain coordinates of all initial states, `starts` in
    total: each is a displacement or a change of velocity, divided by its standard deviation. Arrays of readings are (T, width): one row
    for each of the T control periods of an episode, and the columns of all channels.

    Args:
        simulator: Simulator of the readings.
        step: Half width of the central differences, in the units of x.

    Attributes:
        sigma: Noise of each column of the readings, (width,), in the units of the channels.
        n: Number of parameters, which are the first numbers of x.
        low, high: Bounds of x, (n + starts,).
        start: Initial value of x for the search, (n + starts,).
    """

    def __init__(self, simulator: Simulator, step: float):
        self.simulator, self.step, self.blocks = simulator, step, simulator.blocks
        self.scale = np.concatenate([block.scale for block in self.blocks])
        self.n = len(self.scale)
        self._starts, self._places = _unknown_starts(simulator.episodes, self.n)
        extra = self._places[-1].stop - self.n if self._places else 0
        free = np.full(extra, np.inf)
        self.low, self.high, self.start = (
            np.concatenate([np.concatenate([getattr(block, end) for block in self.blocks]) / self.scale, other])
            for end, other in (("low", -free), ("high", free), ("start", np.zeros(extra)))
        )
        self.priors = _priors(self.blocks, self.scale)
        self.masks = [np.isfinite(m) for m in simulator.measured]
        self.sigma = np.ones(simulator.width)
        self.count = sum(int(mask.sum()) for mask in self.masks)

    def shifted(self, shift: int) -> Residuals:
        """Residuals of the same episodes and noise, with the readings shifted in time by one control period relative to the controls.

        Args:
            shift: `LATE` (1) compares the prediction for control period k with the reading of period k + 1, `EARLY` (-1) with the
                reading of period k - 1.
        """
        out = Residuals(self.simulator.with_episodes([shifted(episode, shift) for episode in self.simulator.episodes]), self.step)
        out.sigma = self.sigma
        return out

    def first_part(self, share: float) -> Residuals:
        """Residuals of the first periods of all episodes, at least one of each, with the same noise.

        Args:
            share: Number of these periods, divided by the number of periods of an episode.
        """
        parts = []
        for e in self.simulator.episodes:
            count = math.ceil(share * len(np.asarray(e.ctrl)))
            readings, applied = ({name: np.asarray(rows)[:count] for name, rows in kind.items()} for kind in (e.readings, e.applied))
            parts.append(replace(e, ctrl=np.asarray(e.ctrl)[:count], readings=readings, applied=applied))
        out = Residuals(self.simulator.with_episodes(parts), self.step)
        out.sigma = self.sigma
        return out

    def freed(self, start_std: tuple[float, float]) -> Residuals | None:
        """Residuals of the same episodes and noise, with exact initial states replaced by uncertain ones.

        Args:
            start_std: Standard deviations of displacement (m, rad) and velocity (m/s, rad/s).

        Returns:
            The residuals, or None if no episode has an exact initial state.
        """
        episodes = self.simulator.episodes
        exact = [start is None for start in self._starts]
        if not any(exact):
            return None
        own = [replace(e, start_std=start_std).checked(self.simulator.model) if x else e for e, x in zip(episodes, exact, strict=True)]
        out = Residuals(self.simulator.with_episodes(own), self.step)
        out.sigma = self.sigma
        return out

    def linearize(self, points: Sequence[Array], step: float | None = None, sides: int = 2) -> list[Linearized]:
        """Residuals and Jacobians at several points, from one batch of environments.

        Args:
            points: Vectors x, (n + starts,) each: n parameters, then the uncertain coordinates of the initial states.
            step: Half width of the central differences; None uses the constructor's half width.
            sides: Number of displaced values of each coordinate: 2 for central differences, 1 for one-sided ones.
        """
        width = self._wide()
        asked = [self._around(x, self.step if step is None else step, width, sides) for x in points]
        made = self._predict(np.concatenate([rows for rows, _ in asked]))
        each = 1 + sides * (self.n + width)
        return [self._assemble(x, [y[k * each : (k + 1) * each] for y in made], asked[k][1], width) for k, x in enumerate(points)]

    def residuals(self, points: Array) -> Array:
        """Residual vectors, (count, m), at several points, without Jacobians.

        Args:
            points: Vectors x, (count, n + starts): n parameters, then the uncertain coordinates of the initial states.
        """
        compact = np.zeros((len(points), self.n + self._wide()))
        compact[:, : self.n] = points[:, : self.n]
        made = self._predict(compact, points)
        return np.stack([self._with_priors(x, [y[k] for y in made]) for k, x in enumerate(points)])

    def whitened(self, linearized: Linearized) -> list[Array]:
        """Residuals of the readings, in units of their noise, by episode: (T, width) each, with NaN where nothing was measured."""
        out, at = [], 0
        for mask in self.masks:
            rows = np.full(mask.shape, np.nan)
            rows[mask] = linearized.residual[at : at + mask.sum()]
            at += mask.sum()
            out.append(rows)
        return out

    def reading_indices(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Indices of all measured readings, (count, 3): index of the episode, index of the control period, and column of the readings."""
        return np.concatenate([np.insert(np.argwhere(mask), 0, e, axis=1) for e, mask in enumerate(self.masks)])

    def _wide(self) -> int:
        """Largest number of uncertain coordinates of the initial state in any episode, 0 if all initial states are exact."""
        return max((len(s) for s in self._starts if s is not None), default=0)

    def _around(self, x: Array, step: float, width: int, sides: int) -> tuple[Array, Array]:
        """Vectors to simulate for differences of the predicted readings around a vector x of unknowns.

        The unknowns are n parameters and the uncertain coordinates of the initial states. A simulation displaces the k-th uncertain
        coordinate of all episodes at once, because the episodes are independent.

        Args:
            x: The vector, (n + starts,): n parameters, then the uncertain coordinates of the initial states.
            step: Half width of the differences.
            width: Largest number of uncertain coordinates of the initial state in any episode.
            sides: Number of displaced values of each coordinate, 2 or 1.

        Returns:
            rows: Array with one row per simulation: n parameters, `width` displacements of the initial states of all episodes, and the
                coordinates of the initial states in x.
            spans: Distances from x to the displaced values above and below, (n + width, 2). With one side, (n + width, 1): to the value
                above, or at an upper bound minus the distance to the value below.
        """
        rows = np.zeros((1 + 2 * (self.n + width), self.n + width))
        rows[:, : self.n] = x[: self.n]
        spans = np.full((self.n + width, 2), step)
        for j in range(self.n + width):
            up, down = (x[j] + step, x[j] - step) if j < self.n else (step, -step)
            if j < self.n:
                up, down = min(up, self.high[j]), max(down, self.low[j])
                spans[j] = up - x[j], x[j] - down
            rows[1 + 2 * j, j], rows[2 + 2 * j, j] = up, down
        if sides == 1:
            below = spans[:, 0] < 0.1 * step  # The upper bound is nearer than the step.
            rows = np.concatenate([rows[:1], np.where(below[:, None], rows[2::2], rows[1::2])])
            spans = np.where(below, -spans[:, 1], spans[:, 0])[:, None]
        # Each row ends with the initial states of x, to which the common displacement is added.
        return np.concatenate([rows, np.tile(x[self.n :], (len(rows), 1))], axis=1), spans

    def _predict(self, rows: Array, points: Array | None = None) -> list[Array]:
        """Predicted readings by episode, (count, T, width) each, for `count` rows of `_around`.

        The initial states are those of the vectors x in `points`, (count, n + starts), or of the rows themselves.
        """
        width = self._wide()
        own = rows[:, self.n + width :] if points is None else points[:, self.n :]
        starts: list[tuple[Array, Array] | None] = []
        for std, place in zip(self._starts, self._places, strict=True):
            if std is None:
                starts.append(None)
                continue
            nv = self.simulator.model.nv
            shift = np.zeros((len(rows), 2 * nv))
            chosen = std[:, 0].astype(int)
            mine = slice(place.start - self.n, place.stop - self.n)
            shift[:, chosen] = (own[:, mine] + rows[:, self.n : self.n + len(chosen)]) * std[:, 1]
            starts.append((shift[:, :nv], shift[:, nv:]))
        return self.simulator.predict(rows[:, : self.n] * self.scale, starts if any(s is not None for s in starts) else None)

    def _with_priors(self, x: Array, y: list[Array]) -> Array:
        """Residual vector at a point x, (m,): of the predicted readings by episode, of the priors, and of the initial states."""
        parts = [((p - m) / self.sigma)[mask] for p, m, mask in zip(y, self.simulator.measured, self.masks, strict=True)]
        parts += [np.array([(x[j] - mean) / std]) for j, mean, std in self.priors]
        return np.concatenate([*parts, x[self.n :]])

    def _assemble(self, x: Array, made: list[Array], spans: Array, width: int) -> Linearized:
        """Residuals and Jacobian at a point x from predictions at the points of central differences, with spans as from `_around`."""
        residual = self._with_priors(x, [y[0] for y in made])
        jacobian = np.zeros((len(residual), len(x)))
        at = 0
        for y, mask, std, place in zip(made, self.masks, self._starts, self._places, strict=True):
            own = (slopes(y, spans) if spans.shape[1] == 2 else (y[1:] - y[0]) / spans[:, :, None]) / self.sigma
            here = slice(at, at + int(mask.sum()))
            jacobian[here, : self.n] = own[: self.n][:, mask].T
            if std is not None:
                jacobian[here, place] = own[self.n : self.n + len(std)][:, mask].T
            at = here.stop
        for k, (j, _, deviation) in enumerate(self.priors):
            jacobian[at + k, j] = 1 / deviation
        jacobian[at + len(self.priors) :, self.n :] = np.eye(len(x) - self.n)
        return Linearized(residual, jacobian, self.count)


def slopes(y: Array, spans: Array) -> Array:
    """Derivatives of readings by central differences, (k, T, width).

    If a reading jumps on one side, because a contact closes one sample earlier, the difference on the other side is used.

    Args:
        y: Readings at a point, and then above and below for each coordinate, (1 + 2 k, T, width).
        spans: Distances above and below, (k, 2), in the unit of the coordinate.
    """
    # At a bound, the difference on the side with almost no width is ignored.
    wide = (spans > 0.1 * spans.max(axis=1, keepdims=True))[..., None, None]
    widths = np.maximum(spans, 1e-300)[..., None, None]
    above, below = (y[1::2] - y[0]) / widths[:, 0], (y[0] - y[2::2]) / widths[:, 1]
    above, below = np.where(wide[:, 0], above, below), np.where(wide[:, 1], below, above)
    larger = np.maximum(np.abs(above), np.abs(below))
    calm = np.where(np.abs(above) < np.abs(below), above, below)
    return np.asarray(np.where(np.abs(above - below) > JUMP * larger, calm, (above + below) / 2))


def _unknown_starts(episodes: Sequence[Episode], n: int) -> tuple[list[Array | None], list[slice]]:
    """Uncertain coordinates of the initial state of each episode, and their places in the vector x of unknowns (see `Residuals`).

    Returns two lists with an entry for each episode. The first has an array (k, 2) with a row for each of its k uncertain coordinates, or
    None if k is 0. A row is the index among the 2 nv displacements (m, rad) and velocities (m/s, rad/s), and the standard deviation. The
    second has the slice of x, after its n parameters, with these k coordinates.
    """
    starts: list[Array | None] = []
    places = []
    at = n
    for episode in episodes:
        std = np.concatenate([np.asarray(s) for s in episode.start_std]) if episode.start_std is not None else np.zeros(0)
        chosen = np.flatnonzero(std)
        starts.append(np.stack([chosen, std[chosen]], axis=1) if len(chosen) else None)
        places.append(slice(at, at + len(chosen)))
        at += len(chosen)
    return starts, places


def _priors(blocks: Sequence[object], scale: Array) -> list[tuple[int, float, float]]:
    """Index in x of each parameter with a prior, and the mean and standard deviation of the prior in units of the parameter's scale."""
    out, at = [], 0
    for block in blocks:
        prior = getattr(block, "prior", None)
        size = int(getattr(block, "size", 0))
        if prior is not None:
            out += [(at + k, float(prior[0][k] / scale[at + k]), float(prior[1][k] / scale[at + k])) for k in range(size)]
        at += size
    return out


class Together:
    """Batch evaluation of residuals for several searches, each in a thread.

    Each search submits its next point and waits. The last search to submit evaluates the points of all searches in one batch.

    Args:
        residuals: Residuals to evaluate.
        searches: Number of searches.
        sides: Argument of `Residuals.linearize`.
    """

    def __init__(self, residuals: Residuals, searches: int, sides: int = 2):
        self._residuals, self._active, self._sides = residuals, searches, sides
        self._asked: dict[int, Array] = {}
        self._answers: dict[int, Linearized | BaseException] = {}
        self._turn = threading.Condition()
        self._stopped = False

    def stop(self) -> None:
        """Ends all searches: the next call of `ask` by each search raises InterruptedError."""
        with self._turn:
            self._stopped = True
            self._turn.notify_all()

    def ask(self, search: int, x: Array) -> Linearized:
        """Submits the next point of a search, and returns the residuals there.

        Waits until all other searches have submitted a point or ended.

        Args:
            search: Index of the search.
            x: The point, (n + starts,), in units of the scales.
        """
        with self._turn:
            self._asked[search] = x
            if not self._stopped:
                self._answer()
                self._turn.wait_for(lambda: search in self._answers or self._stopped)
            if self._stopped:
                raise InterruptedError("another search was interrupted: run identify again")
            answer = self._answers.pop(search)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def leave(self) -> None:
        """Ends the participation of one search, so that the other searches do not wait for its next point."""
        with self._turn:
            self._active -= 1
            if not self._stopped:
                self._answer()

    def _answer(self) -> None:
        """Evaluates all submitted points in one batch, if every active search has submitted a point; otherwise does nothing."""
        if not self._asked or len(self._asked) < self._active:
            return
        searches = sorted(self._asked)
        try:
            answers: list[Linearized | BaseException] = list(
                self._residuals.linearize([self._asked[k] for k in searches], sides=self._sides)
            )
        except BaseException as error:
            answers = [error] * len(searches)
        self._answers.update(zip(searches, answers, strict=True))
        self._asked.clear()
        self._turn.notify_all()
