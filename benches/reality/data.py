"""Measured motions in the layout of a data folder: one subfolder per data set, with an archive or a table."""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stepper.shared.files import existing, read_arrays
from stepper.shared.rotations import matrices, rotation_vectors

Array = NDArray[np.float64]
PERIOD = 1 / 148
"""Time between two samples of the tosses, s."""
HALF = 0.0524
"""Half width of the tossed cube, m."""
ELBOW_HALF = np.array([0.05, 0.025, 0.025])
"""Half widths of each link of the tossed elbow, m."""
ELBOW_HINGE, ELBOW_CENTRE = (-0.035, 0.06, 0.0), (0.035, 0.0, 0.0)
"""Position of the elbow's hinge, along y, in axes of the first link; position of the second link's centre from the hinge in its axes, m."""
ELBOW_SAMPLES = 70
"""Number of samples of a toss of the elbow, until 0.45 s after the first contact."""
G = 9.81
"""Gravity, m/s^2."""


def unit(q: Array) -> Array:
    """Quaternions (..., 4) of length 1."""
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def turn(q: Array, r: Array) -> Array:
    """Angle in rad between orientations (w, x, y, z), (..., 4), with a sign for neither direction, (...)."""
    return np.asarray(np.linalg.norm(rotation_vectors(unit(q), unit(r)), axis=-1))


def _lowest(q: Array, half: Array) -> Array:
    """Height of the lowest corner of boxes above their centres, (...), m, with orientations (..., 4) and half widths (3,), m."""
    return np.asarray(-np.abs(matrices(unit(q))[..., 2, :]) @ half)


@dataclass(frozen=True)
class Toss:
    """Recording of a toss from shortly before the first contact.

    Attributes:
        pose: Measured positions, m, and orientations (w, x, y, z), (samples, 7), or (samples, 8) with the angle of a hinge, rad.
        start: Initial state, (13,) or (15,): the first pose, velocity in world axes, m/s, and angular velocity in body axes, rad/s, and the
            rate of the hinge, rad/s.
        impact: Index of the sample before the first contact.
        fall: Acceleration of the flight before, m/s^2, downward, with the nominal sample period; NaN if the flight is too short.
    """

    pose: Array
    start: Array
    impact: int
    fall: float


def _cut(pose: Array, velocity: Array, gravity: float) -> Toss:
    """Toss from three samples before the first possible contact; the initial velocity is fitted to the flight before, as published."""
    first = max(0, int(np.argmax(pose[:, 2] <= HALF * np.sqrt(3.0))) - 3)
    start = np.r_[pose[first], velocity[first]]
    if first >= 4:
        t = np.arange(first) * PERIOD
        line = np.linalg.lstsq(np.c_[np.ones(first), t], pose[:first, 2] + 0.5 * gravity * t**2, rcond=None)[0]
        start[7:9] = (pose[first - 1, :2] - pose[0, :2]) / t[-1]
        start[9] = line[1] - gravity * t[-1]
        start[10:] = rotation_vectors(*unit(pose[[0, first], 3:])) / (PERIOD * first)
    low = (pose[:, 2] + _lowest(pose[:, 3:], np.full(3, HALF)))[first:]
    flight, height = first + 3, pose[:, 2]
    fall = -2.0 * np.polyfit(np.arange(flight) * PERIOD, height[:flight], 2)[0] if flight >= 12 else np.nan
    return Toss(pose[first:], start, max(0, int(np.argmax(low < 0.002)) - 1), float(fall))


def cube_tosses(folder: Path, gravity: float = G) -> list[Toss]:
    """All tosses of the data set `cube_toss` in a data folder."""
    arrays = data_set(folder, "cube_toss")
    start, pose, velocity = arrays["start"], arrays["pose"].astype(float), arrays["vel"].astype(float)
    return [_cut(pose[a:b], velocity[a:b], gravity) for a, b in itertools.pairwise(start)]


def elbow_bodies(pose: Array) -> Array:
    """Positions, m, and orientations (w, x, y, z) of both links, (..., 2, 7), of poses (..., 8), which end with the hinge's angle, rad."""
    place, q = pose[..., :3], unit(pose[..., 3:7])
    cos, sin = np.cos(pose[..., 7] / 2.0), np.sin(pose[..., 7] / 2.0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    second = np.stack([w * cos - y * sin, x * cos - z * sin, w * sin + y * cos, z * cos + x * sin], axis=-1)
    shift = matrices(q) @ np.array(ELBOW_HINGE) + matrices(second) @ np.array(ELBOW_CENTRE)
    return np.stack([np.concatenate([place, q], -1), np.concatenate([place + shift, second], -1)], axis=-2)


def elbow_tosses(folder: Path, _: float = G) -> list[Toss]:
    """Tosses of the data set `elbow_toss` in a data folder that begin with a free flight, from three samples before the first contact.

    The initial velocity is that of parabolas through ten samples of the flight. A flight is free if the mean of both centres falls with
    9.6 m/s^2 to within 1 m/s^2; others begin in the hand.
    """
    arrays, found = data_set(folder, "elbow_toss"), []
    for a, b in itertools.pairwise(arrays["start"]):
        pose = arrays["pose"][a:b].astype(float)
        pose[:, 7] = np.unwrap(pose[:, 7])
        bodies = elbow_bodies(pose)
        low = (bodies[..., 2] + _lowest(bodies[..., 3:], ELBOW_HALF)).min(axis=1)
        touch = int(np.argmax(low < 0.008))
        if touch < 12:
            continue
        fall = -2.0 * np.polyfit(np.arange(touch) * PERIOD, bodies[:touch, :, 2].mean(axis=1), 2)[0]
        if abs(fall - 9.6) < 1.0:
            first, flight = touch - 3, pose[touch - 10 : touch]
            turns = rotation_vectors(unit(pose[first, 3:7]), unit(flight[:, 3:7]))
            rates = np.polyfit(np.arange(-7, 3) * PERIOD, np.c_[flight[:, :3], turns, flight[:, 7]], 2)[1]
            found.append(Toss(pose[first : first + ELBOW_SAMPLES], np.r_[pose[first], rates], 2, float(fall)))
    return found


def data_set(folder: Path, name: str) -> dict[str, Any]:
    """Arrays of the archive NAME/NAME.npz of a data folder."""
    path = existing(folder / name / f"{name}.npz", f"{name} data")
    return dict(read_arrays(path, "data set"))
