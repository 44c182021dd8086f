"""Online identification of a box that two fingers hold at rest and then shake until it slips, from wrist force and an encoder.

The wrist torque about y is not used: rigid-body statics does not determine the distribution of the weight over the fingers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import stepper
from sections import Table

from identification.followed import Followed, followed
from identification.scenes import HARD, by_sensor, held

STILL, SHAKEN = 1.0, 3.0
"""Durations of holding the box at rest and of shaking it, s."""
PERIOD = 0.02
"""Time between controls, s."""
NOISE = {"wrist_force": 0.3, "lift": 1e-4}
"""Standard deviations of the sensor noise by channel, N and m."""
MARKS = (0.9, 2.4, 4.0)
"""Times at which intervals are compared with the truth, s."""


def controls() -> np.ndarray[Any, Any]:
    """Controls of all T periods, (T, 3): target height of the hand (m), and squeeze forces of the left and right finger (N)."""
    t = np.arange(round((STILL + SHAKEN) / PERIOD)) * PERIOD
    ramp = np.clip((t - STILL) / 0.4, 0, 1)
    lift = 0.03 * (np.sin(2 * np.pi * 1.0 * t) + 0.5 * np.sin(2 * np.pi * 2.6 * t)) * ramp
    return np.stack([lift, np.full_like(t, 12.0), np.full_like(t, 12.0)], axis=1)


def readings(masses: np.ndarray[Any, Any], friction: float) -> dict[str, np.ndarray[Any, Any]]:
    """Ideal sensor readings by channel, for masses of the box over time (T,)."""
    model = held().model(float(masses[0]), friction)
    sim = stepper.Stepper(model, options=HARD)
    rows, now = [], masses[0]
    for mass, ctrl in zip(masses, controls(), strict=True):
        if mass != now:
            now = mass
            ratio = np.ones(model.nbody)
            ratio[model.body("box").id] = mass / masses[0]
            sim.randomize(body_mass=model.body_mass * ratio, body_inertia=model.body_inertia * ratio[:, None])
        rows.append(sim.rollout(ctrl[None], round(PERIOD / sim.timestep), fields=("sensordata",))["sensordata"][0])
    return by_sensor(model, np.stack(rows), NOISE)


def follow(seed: int, changes: bool = False, marks: Sequence[float] = MARKS) -> Followed:
    """Run a tracker on the shaken box with the noise of a seed, and return its results at the times `marks`, s.

    With `changes` the mass decreases by a quarter after 2.6 s.
    """
    rng = np.random.default_rng(seed)
    ctrl = controls()
    t = (1 + np.arange(len(ctrl))) * PERIOD
    mass, friction = 0.8 * np.exp(rng.uniform(-0.1, 0.1)), 0.45 * np.exp(rng.uniform(-0.05, 0.05))
    masses = np.where(changes & (t > 2.6), 0.75, 1.0) * mass
    clean = readings(masses, friction)
    noisy = {name: rows + NOISE[name] * rng.standard_normal(rows.shape) for name, rows in clean.items()}
    scene = held()
    tracker = stepper.sysid.Tracker(
        scene.model(*scene.starts[0]),
        list(scene.parameters),
        noise=NOISE,
        period=PERIOD,
        drift=(0.2, 0.02) if changes else None,
        options=HARD,
    )
    counts = [round(mark / PERIOD) for mark in marks]
    return followed(tracker, ctrl[: max(counts)], noisy, {count: np.array([masses[count - 1], friction]) for count in counts})


def table(count: int) -> Table:
    """Table of online identifications: `count` runs with constant parameters, and `count` runs with a changing mass."""
    head = ("mass error", "interval", "coverage", "friction determined", "error", "interval", "coverage", "update", "99 % of updates")
    made = Table("box", "after", *head)
    for name, changes in (("constant", False), ("loses a quarter of its mass at 2.6 s", True)):
        runs = [follow(seed, changes) for seed in range(count)]
        milliseconds = 1e3 * np.concatenate([run.seconds for run in runs])
        for k, mark in enumerate(MARKS):
            determined = np.array([run.determined[k, 1] for run in runs])
            cells = []
            for j in (0, 1):
                some = [run for run, known in zip(runs, determined, strict=True) if j == 0 or known]
                error = np.sqrt(np.mean([run.error[k, j] ** 2 for run in some])) if some else np.nan
                width = np.median([run.width[k, j] for run in some]) if some else np.nan
                cells += [f"{100 * error:.2g} %", f"{100 * width:.2g} %"] if some else ["-", "-"]
                cells += [f"{100 * np.mean([run.covers[k, j] for run in runs]):.0f} %"]
            cells.insert(3, f"{100 * determined.mean():.0f} %")
            made.add(name, f"{mark:g} s", *cells, *(f"{value:.0f} ms" for value in np.percentile(milliseconds, (50, 99))))
    return made
