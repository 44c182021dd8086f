"""Real tosses of a cube: each engine is fitted to one half of the tosses, and predicts the other half.

The error of a toss is the mean over time of d^2 / 0.0524 m + theta^2, with the distance d in m and the angle theta in rad. It is that of
B. Acosta, W. Yang and M. Posa, "Validating robotics simulators on real-world impacts", IEEE Robotics and Automation Letters 7, 2022. The
published fits used all tosses; here the half with even numbers is fitted, and the odd half is predicted.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stepper.lab.calibration.fit import bootstrap, fit

from reality.engines import Table, TossEngine
from reality.recordings import HALF, PERIOD, Toss, cube_tosses, free_fall, turn

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


def errors(poses: Array, tosses: Sequence[Toss]) -> tuple[Array, Array, Array]:
    """Error, distance (m) and angle (rad) of simulated poses at each sample, (tosses, samples) each; NaN after the end of a toss."""
    far, angle = np.full(poses.shape[:2], np.nan), np.full(poses.shape[:2], np.nan)
    for k, toss in enumerate(tosses):
        n = len(toss.pose)
        far[k, :n] = np.linalg.norm(poses[k, :n, :3] - toss.pose[:, :3], axis=1)
        angle[k, :n] = turn(poses[k, :n, 3:], toss.pose[:, 3:])
    return far**2 / HALF + angle**2, far, angle


def fitted(engine: TossEngine, tosses: Sequence[Toss], gravity: float, *, nuisances: bool) -> tuple[dict[str, float], Table, int]:
    """Parameters of an engine, and the experiment, that fit tosses best; and the number of evaluations.

    `nuisances` are the height of the table and the radius of the corners.
    """
    bounds = {**engine.bounds, **(OFFSETS if nuisances else {})}
    count, some = len(engine.bounds), tosses[:: engine.stride]

    def parts(sample: Array) -> tuple[dict[str, float], Table]:
        return engine.values(sample[:count]), Table(gravity, *sample[count:].tolist())

    def loss(samples: Array) -> Array:
        return np.array([np.nanmean(errors(engine.poses(*parts(sample), some, FITTED_AT), some)[0], axis=1).mean() for sample in samples])

    low, high = np.array(list(bounds.values())).T
    found = fit(loss, low, high, samples=16, rounds=5)
    return *parts(found.values), found.evaluations


def measured(engine: TossEngine, folder: Path, *, nuisances: bool, progress: Any = print) -> Iterator[Row]:
    """Rows of an engine: fit of the even tosses, errors of both halves at each time step, errors against time since the first contact."""
    even = np.arange(0, len(cube_tosses(folder)), 2)
    gravity = free_fall(folder, even) if nuisances else Table().gravity
    every = cube_tosses(folder, gravity)
    values, table, evaluations = fitted(engine, every[::2], gravity, nuisances=nuisances)
    told = values | ({"gravity": gravity, "offset": table.offset, "radius": table.radius} if nuisances else {})
    about = {"engine": engine.name, "nuisances": "fitted" if nuisances else "none"}
    text = "; ".join(f"{name} {value:.4g}" for name, value in told.items())
    progress(f"{engine.name}: {text} ({evaluations} evaluations)")
    for half, tosses in (("fitted", every[::2]), ("held out", every[1::2])):
        for substeps in REFINED:
            error, far, angle = errors(engine.poses(values, table, tosses, substeps), tosses)
            each = np.nanmean(error, axis=1)
            mean, median = bootstrap(each), bootstrap(each, np.median)
            yield about | {
                "half": half, "tosses": len(tosses), "timestep_s": PERIOD / substeps, "horizon_s": "",
                "mean": each.mean(), "mean_low": mean[0], "mean_high": mean[1],
                "median": np.median(each), "median_low": median[0], "median_high": median[1],
                "distance_percent": 100.0 * np.nanmean(np.nanmean(far, axis=1)) / (2.0 * HALF),
                "angle_deg": np.degrees(np.nanmean(np.nanmean(angle, axis=1))), "parameters": text,
            }  # fmt: skip
        for horizon in HORIZONS:
            at = np.array([toss.impact + round(horizon / PERIOD) for toss in tosses])
            inside = at < [len(toss.pose) for toss in tosses]
            each = error[inside, at[inside]]
            mean, median = bootstrap(each), bootstrap(each, np.median)
            yield about | {
                "half": half, "tosses": int(inside.sum()), "timestep_s": PERIOD / REFINED[-1], "horizon_s": horizon,
                "mean": each.mean(), "mean_low": mean[0], "mean_high": mean[1],
                "median": np.median(each), "median_low": median[0], "median_high": median[1],
                "distance_percent": 100.0 * far[inside, at[inside]].mean() / (2.0 * HALF),
                "angle_deg": np.degrees(angle[inside, at[inside]].mean()), "parameters": text,
            }  # fmt: skip
