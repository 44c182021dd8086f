"""Real tosses of a cube, and of two links with a hinge: each engine is fitted to one half of the tosses, and predicts the other half.

The error of a toss is the mean over time of d^2 / 0.0524 m + theta^2, with the distance d in m and the angle theta in rad. It is that of
B. Acosta, W. Yang and M. Posa, "Validating robotics simulators on real-world impacts", IEEE Robotics and Automation Letters 7, 2022. The
published fits used all tosses; here the half with even numbers is fitted, and the odd half is predicted.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from atlas.mjcf import numbers
from numpy.typing import NDArray
from stepper.lab.calibration.fit import Fit, bootstrap, fit

from reality.data import ELBOW_CENTRE, ELBOW_HALF, ELBOW_HINGE, HALF, PERIOD, G, Toss, cube_tosses, elbow_bodies, elbow_tosses, turn
from reality.engines import Table, TossEngine, engines

Array = NDArray[np.float64]
Row = dict[str, Any]
Bounds = dict[str, tuple[float, float]]
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
        engines: Bounds of the engines' own parameters by the name of the engine; None for all engines with the bounds of the cube.
        samples: Number of samples of a toss in its mean error and in fits; None uses all.
        draws, rounds: Number of draws per round, and of rounds, of a fit.
        continued: Whether a fit with nuisances starts at the fit without them.
    """

    name: str
    size: float
    table: type[Table]
    tosses: Callable[[Path, float], list[Toss]]
    bodies: Callable[[Array], Array]
    nuisances: Bounds
    engines: dict[str, Bounds] | None = None
    bounds: Bounds = field(default_factory=dict)
    samples: int | None = None
    draws: int = 16
    rounds: int = 5
    continued: bool = False

    def made_engines(self) -> list[TossEngine]:
        """Engines that toss the object."""
        if self.engines is None:
            return engines()
        return [replace(engine, bounds=self.engines[engine.name], stride=1) for engine in engines() if engine.name in self.engines]

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
    engine: TossEngine, tosses: Sequence[Toss], gravity: float, experiment: Experiment, *, nuisances: bool, start: Array | None
) -> tuple[dict[str, float], Table, dict[str, float], Fit]:
    """Parameters of an engine, the model, and its fitted parameters, that fit tosses best; and the fit.

    `start` has the values of a fit without nuisances, at which the search starts; None searches everywhere.
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
    start: Array | None = None
    gravity, every = G, experiment.tosses(folder, G)
    for nuisances in (False, True):
        if nuisances:
            gravity = float(np.nanmedian([toss.fall for toss in every[::2]]))
            every = experiment.tosses(folder, gravity)
        values, table, extra, found = fitted(engine, every[::2], gravity, experiment, nuisances=nuisances, start=start)
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
    row: Row = {}
    for name, statistic in (("mean", np.mean), ("median", np.median)):
        row[name] = statistic(error)
        row[f"{name}_low"], row[f"{name}_high"] = bootstrap(error, statistic)
    return row | {"distance_percent": 100.0 * distance.mean() / (2.0 * size), "angle_deg": np.degrees(angle.mean())}


LINK_MASS, LINK_INERTIA = 0.37, 0.0006167
"""Mass of a link, kg, and its moments of inertia, kg m^2, as published: nominal values, not measured ones."""


@dataclass(frozen=True)
class Elbow(Table):
    """Differences of the experiment with the elbow from its nominal description, and the friction of the hinge.

    Attributes:
        inertia: Moments of inertia of both links in relation to the published ones.
        hinge_damping: Viscous friction of the hinge, N m s/rad.
        hinge_friction: Dry friction of the hinge, N m.
    """

    inertia: float = 1.0
    hinge_damping: float = 0.0
    hinge_friction: float = 0.0

    def mjcf(self, geom: str, option: str = "") -> str:
        """Model of the table and both links in MJCF. Links touch the table alone, as in the published description."""

        def link(centre: tuple[float, ...]) -> str:
            inertial = f'<inertial pos="{numbers(centre)}" mass="{LINK_MASS}" diaginertia="{numbers([self.inertia * LINK_INERTIA] * 3)}"/>'
            return inertial + self.box(ELBOW_HALF, centre)

        hinge = f'<joint axis="0 1 0" damping="{self.hinge_damping!r}" frictionloss="{self.hinge_friction!r}"/>'
        return f"""<mujoco><option gravity="{numbers([0, 0, -self.gravity])}">{option}</option>
          <default><geom contype="1" conaffinity="2" {geom}/></default><worldbody>
          <geom type="plane" size="5 5 1" contype="2" conaffinity="1" pos="{numbers([0, 0, self.offset])}"/>
          <body name="first"><freejoint/>{link((0.0, 0.0, 0.0))}
          <body name="second" pos="{numbers(ELBOW_HINGE)}">{hinge}{link(ELBOW_CENTRE)}</body></body></worldbody></mujoco>"""


_FRICTION = {"friction": (0.05, 0.5)}
ELBOW = Experiment(
    "elbow_toss",
    0.05,
    Elbow,
    elbow_tosses,
    elbow_bodies,
    {"offset": (-0.003, 0.003), "radius": (0.0005, 0.006), "inertia": (0.3, 1.5)},
    {
        "stepper": _FRICTION | {"restitution": (0.0, 0.5)},
        "stepper, compliant table": _FRICTION | {"log stiffness": (2.5, 5.5), "log damping": (0.3, 3.0)},
        "MuJoCo, elliptic cone": _FRICTION | {"log stiffness": (3.0, 6.5), "log damping": (1.0, 3.7), "impedance": (0.1, 0.98)},
    },
    {"hinge_damping": (0.0, 0.006), "hinge_friction": (0.0, 0.015)},
    samples=2 + round(0.1 / PERIOD),
    draws=32,
    rounds=16,
    continued=True,
)
"""Tosses of the elbow. Errors are those of the first 0.1 s after the first contact."""
EXPERIMENTS = (CUBE, ELBOW)
