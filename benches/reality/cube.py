"""Real tosses of a cube: each engine is fitted to one half of the tosses, and predicts the other half.

The error of a toss is the mean over time of d^2 / 0.0524 m + theta^2, with the distance d in m and the angle theta in rad. It is that of
B. Acosta, W. Yang and M. Posa, "Validating robotics simulators on real-world impacts", IEEE Robotics and Automation Letters 7, 2022. The
published fits used all tosses; here the half with even numbers is fitted, and the odd half is predicted.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stepper.lab.calibration.fit import Fit, bootstrap, fit

from reality.data import HALF, PERIOD, G, Toss, cube_tosses, turn
from reality.engines import Table, TossEngine

Array = NDArray[np.float64]
Row = dict[str, Any]
FITTED_AT = 4
"""Time steps per sample in fits: 1/592 s."""
REFINED = (1, 4, 10)
"""Time steps per sample in predictions: 1/148, 1/592 and 1/1480 s, of which the last is that of the published comparison."""
PUBLISHED_STEP = PERIOD / REFINED[-1]
"""Time step of the published comparison, s."""
OFFSETS = {"offset": (-0.004, 0.001), "radius": (0.0005, 0.01)}
"""Bounds of the height of the table and of the radius of the cube's corners, m. They are fitted for all engines alike, or for none."""
HORIZONS = np.arange(0.05, 0.451, 0.05)
"""Times since the first contact at which errors are told, s."""


@dataclass(frozen=True)
class Experiment:
    """Tosses of an object onto a table.

    Attributes:
        name: Name of the data set.
        size: Length that divides squared distances in the error, half the width of a body, m.
        table: Class of the model, a `Table`.
        tosses: Function of the data folder and of gravity, m/s^2, that returns all tosses.
        bodies: Function that turns recorded poses, (..., nq), into positions, m, and orientations of all bodies, (..., bodies, 7).
        bounds: Bounds of fitted parameters of the object by their name in `table`.
        nuisances: Bounds of fitted nuisances by their name in `table`.
        samples: Number of samples of a toss in its mean error and in fits; None uses all.
        draws, rounds: Number of draws per round, and of rounds, of a fit.
        continued: Whether a fit with nuisances starts at the fit without them.
    """

    name: str
    size: float
    table: type[Table]
    tosses: Callable[[Path, float], list[Toss]]
    bodies: Callable[[Array], Array]
    nuisances: dict[str, tuple[float, float]]
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)
    samples: int | None = None
    draws: int = 16
    rounds: int = 5
    continued: bool = False

    def errors(self, poses: Array, tosses: Sequence[Toss]) -> tuple[Array, Array, Array]:
        """Error, distance (m) and angle (rad) of simulated poses at each sample, (tosses, samples) each; NaN after the end of a toss.

        All three are means over the bodies. They are infinite where the simulation diverged.
        """
        recorded = np.full(poses.shape, np.nan)
        for toss, row in zip(tosses, recorded, strict=True):
            row[: len(toss.pose)] = toss.pose
        real, made = self.bodies(recorded), self.bodies(poses)
        distance, turned = np.linalg.norm(made[..., :3] - real[..., :3], axis=-1), turn(made[..., 3:], real[..., 3:])
        diverged = ~np.isnan(recorded).any(axis=-1) & np.isnan(poses).any(axis=-1)
        distance[diverged], turned[diverged] = np.inf, np.inf
        return (distance**2 / self.size + turned**2).mean(axis=-1), distance.mean(axis=-1), turned.mean(axis=-1)


CUBE = Experiment("cube_toss", HALF, Table, cube_tosses, lambda pose: pose[..., None, :], OFFSETS)


def fitted(
    engine: TossEngine,
    tosses: Sequence[Toss],
    gravity: float,
    *,
    nuisances: bool,
    start: Array | None = None,
    experiment: Experiment = CUBE,
) -> tuple[dict[str, float], Table, dict[str, float], Fit]:
    """Parameters of an engine, the model, and its fitted parameters, that fit tosses best; and the fit.

    Args:
        engine: The engine.
        tosses: The tosses.
        gravity: Gravity, m/s^2.
        nuisances: Whether to fit the nuisances too.
        start: Values of a fit without nuisances, at which the search starts; None searches everywhere.
        experiment: The experiment.
    """
    extra = {**experiment.bounds, **(experiment.nuisances if nuisances else {})}
    bounds = {**engine.bounds, **extra}
    count, some = len(engine.bounds), tosses[:: engine.stride]
    some = [replace(toss, pose=toss.pose[: experiment.samples]) for toss in some]

    def parts(sample: Array) -> tuple[dict[str, float], Table, dict[str, float]]:
        own = dict(zip(extra, sample[count:].tolist(), strict=True))
        return engine.values(sample[:count]), experiment.table(gravity, **own), own

    def loss(samples: Array) -> Array:
        simulated = (engine.poses(*parts(sample)[:2], some, FITTED_AT) for sample in samples)
        return np.array([np.nanmean(experiment.errors(poses, some)[0], axis=1).mean() for poses in simulated])

    low, high = np.array(list(bounds.values())).T
    if start is not None:
        nominal = [getattr(experiment.table(), name) for name in experiment.nuisances]
        start = np.clip(np.r_[start, nominal], low, high)
    found = fit(loss, low, high, samples=experiment.draws, rounds=experiment.rounds, start=start)
    return *parts(found.values), found


def measured(engine: TossEngine, folder: Path, experiment: Experiment = CUBE) -> Iterator[Row]:
    """Rows of an engine, without nuisances and with them: fit of the even tosses, errors of both halves at each time step.

    Errors against time since the first contact follow.
    """
    start, gravity, every = None, G, experiment.tosses(folder, G)
    for nuisances in (False, True):
        if nuisances:
            gravity = float(np.nanmedian([toss.fall for toss in every[::2]]))
            every = experiment.tosses(folder, gravity)
        values, table, extra, found = fitted(engine, every[::2], gravity, nuisances=nuisances, start=start, experiment=experiment)
        start = found.values if experiment.continued else None
        told = values | ({"gravity": gravity} if nuisances else {}) | extra
        text = "; ".join(f"{name} {value:.4g}" for name, value in told.items())
        print(f"{engine.name}: {text} (loss {found.loss:.5f}, {found.evaluations} evaluations)", flush=True)
        for half, tosses in (("fitted", every[::2]), ("held out", every[1::2])):
            about = {"engine": engine.name, "nuisances": "fitted" if nuisances else "none", "half": half}
            for substeps in REFINED:
                errors = experiment.errors(engine.poses(values, table, tosses, substeps), tosses)
                whole = [np.nanmean(own[:, : experiment.samples], axis=1) for own in errors]
                at_step = about | {"tosses": len(tosses), "timestep_s": PERIOD / substeps, "horizon_s": ""}
                yield at_step | _statistics(whole, experiment.size) | {"parameters": text}
            for horizon in HORIZONS:
                at = np.array([toss.impact + round(horizon / PERIOD) for toss in tosses])
                inside = at < [len(toss.pose) for toss in tosses]
                then = [own[inside, at[inside]] for own in errors]
                at_time = about | {"tosses": int(inside.sum()), "timestep_s": PUBLISHED_STEP, "horizon_s": horizon}
                yield at_time | _statistics(then, experiment.size) | {"parameters": text}


def _statistics(parts: Sequence[Array], size: float) -> Row:
    """Columns of a row with the errors, distances (m) and angles (rad) of some tosses, (tosses,) each; `size` is half a body's width, m."""
    error, distance, angle = parts
    mean, median = bootstrap(error), bootstrap(error, np.median)
    return {
        "mean": error.mean(), "mean_low": mean[0], "mean_high": mean[1],
        "median": np.median(error), "median_low": median[0], "median_high": median[1],
        "distance_percent": 100.0 * distance.mean() / (2.0 * size), "angle_deg": np.degrees(angle.mean()),
    }  # fmt: skip
