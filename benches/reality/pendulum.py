"""Real free swings of a single, a double and a triple pendulum: joint friction is fitted to the authors' part, the rest is predicted.

The recordings, and the part for identification, are those of K. Kaheman et al., "The experimental multi-arm pendulum on a cart", 2022.
Masses, lengths and inertias are the published ones. Damping and dry friction of each joint are fitted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from atlas.engines import DEFAULTS, Mujoco, Stepper
from atlas.mjcf import numbers
from numpy.typing import NDArray
from stepper.lab.calibration.fit import bootstrap, fit
from stepper.lab.engines import MujocoEngine

from reality.data import data_set

Array = NDArray[np.float64]
ENGINES = (Stepper("stepper"), Mujoco("MuJoCo", MujocoEngine("implicitfast", DEFAULTS | {"integrator": "implicitfast"})))
"""Engines. Motions without contact depend on the integrator alone."""
TIMESTEP, FITTED_FOR, APART, STRIDE = 0.002, 0.5, 0.25, 4
"""Time step, s; length of the predictions whose error is fitted, s; time between the starts of two predictions, s; and every how
many-th prediction is fitted."""
HORIZONS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Times after the start of a prediction at which errors are told, s."""
LOGARITHMS = (-5.5, -2.5)
"""Bounds of decimal logarithms of a joint's damping, N m s/rad, and of its dry friction, N m."""


@dataclass(frozen=True)
class Swing:
    """Recording of a pendulum.

    Attributes:
        q, dq: Angle and rate of each link from the vertical, pi when it hangs, (samples, links), rad and rad/s.
        period: Time between two samples, s.
        identification: Number of samples of the authors' part for identification.
        mass, inertia: Mass of each link, kg, and inertia about its centre of mass, kg m^2, (links,).
        centre, length: Distances of the centre of mass and of the next joint from the joint of each link, m, (links,).
        gravity: Gravity, m/s^2.
    """

    q: Array
    dq: Array
    period: float
    identification: int
    mass: list[float]
    centre: list[float]
    length: list[float]
    inertia: list[float]
    gravity: float

    def mjcf(self, damping: list[float], friction: list[float]) -> str:
        """Model with damping, N m s/rad, and dry friction, N m, of each joint, (links,). At the joints' zero all links point up."""
        body = ""
        for k in reversed(range(len(self.mass))):
            place, centre, inertia = ([0.0, 0.0, self.length[k - 1] if k else 0.0], [0.0, 0.0, self.centre[k]], [self.inertia[k]] * 3)
            inertial = f'<inertial pos="{numbers(centre)}" mass="{self.mass[k]!r}" diaginertia="{numbers(inertia)}"/>'
            joint = f'<joint axis="0 1 0" damping="{damping[k]!r}" frictionloss="{friction[k]!r}"/>'
            body = f'<body pos="{numbers(place)}">{joint}{inertial}{body}</body>'
        return f'<mujoco><option gravity="0 0 {-self.gravity!r}"/><worldbody>{body}</worldbody></mujoco>'

    def errors(self, engine: Any, values: Array, first: Array, samples: Array) -> Array:
        """Largest angle error of all links, (starts, samples), rad, in predictions from samples `first`, a number of samples later each."""
        damping, friction = values.reshape(2, -1).tolist()
        world = engine.start(self.mjcf(damping, friction), TIMESTEP, len(first))
        # Joint angles are those of a link relative to the link before.
        world.set(*(np.diff(own[first], axis=1, prepend=0.0) for own in (self.q, self.dq)))
        made, done = [], 0
        for count in samples:
            world.step(round((count - done) * self.period / TIMESTEP))
            made.append(np.abs(np.cumsum(world.qpos, axis=1) - self.q[first + count]).max(axis=1))
            done = count
        return np.stack(made, axis=1)


def swings(folder: Path) -> dict[str, Swing]:
    """Recordings of the data set `multiarm_pendulum` in a data folder, by name."""
    arrays, found = data_set(folder, "multiarm_pendulum"), {}
    for n, name in enumerate(("single", "double", "triple"), 1):
        q, dq, published = (np.asarray(arrays[f"{name}_{part}"], float) for part in ("q", "dq", "published_params"))
        mass, centre, length, inertia, _, gravity = (part.tolist() for part in np.split(published, np.cumsum([n, n, n - 1, n, n])))
        period, identification = float(arrays[f"{name}_dt"]), int(arrays[f"{name}_n_train"])
        found[name] = Swing(q, dq, period, identification, mass, centre, length, inertia, gravity[0])
    return found


def measured(engine: Any, folder: Path) -> Iterator[dict[str, Any]]:
    """Rows of an engine: for each pendulum, errors of both parts at each horizon, with the joint friction fitted to the first part."""
    for name, swing in swings(folder).items():
        ends = {"identification": (0, swing.identification), "held out": (swing.identification, len(swing.q))}
        steps = np.round(np.array(HORIZONS) / swing.period).astype(int)
        starts = {part: np.arange(low, high - steps[-1], round(APART / swing.period)) for part, (low, high) in ends.items()}
        until = np.arange(1, 11) * round(FITTED_FOR / 10 / swing.period)

        def loss(samples: Array, swing: Swing = swing, first: Any = starts["identification"][::STRIDE], until: Any = until) -> Array:
            return np.array([swing.errors(engine, 10.0**values, first, until).mean() for values in samples])

        low, high = np.repeat(np.array(LOGARITHMS)[:, None], 2 * len(swing.mass), axis=1)
        found = fit(loss, low, high, samples=16, rounds=8)
        values = 10.0**found.values
        damping, friction = values.reshape(2, -1)
        told = (" ".join(f"{value:.2g}" for value in part) for part in (damping, friction))
        text = "damping {}; dry friction {}".format(*told)
        print(f"{engine.name}, {name}: {text} ({found.evaluations} evaluations)", flush=True)
        for part, first in starts.items():
            every = swing.errors(engine, values, first, steps)
            for horizon, each in zip(HORIZONS, every.T, strict=True):
                below, above = bootstrap(each, np.median)
                yield {
                    "engine": engine.name, "pendulum": name, "part": part, "predictions": len(first), "horizon_s": horizon,
                    "median_rad": np.median(each), "median_low": below, "median_high": above, "within_0.1_rad": (each < 0.1).mean(),
                    "parameters": text,
                }  # fmt: skip
