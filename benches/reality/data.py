"""Measured motions in the layout of a data folder: one subfolder per data set, with an archive or a table."""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stepper.shared.files import existing, read_arrays

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


def turn(q: Array, r: Array) -> Array:
    """Angle in rad between orientations (w, x, y, z), (..., 4), with a sign for neither direction, (...)."""
    norms = np.linalg.norm(q, axis=-1) * np.linalg.norm(r, axis=-1)
    return np.asarray(2.0 * np.arccos(np.clip(np.abs((q * r).sum(axis=-1)) / norms, 0.0, 1.0)))


def rotated(q: Array, points: Array) -> Array:
    """Points (k, 3) of bodies with orientations (w, x, y, z), (n, 4), in world axes, (n, k, 3)."""
    w, v = q[:, None, :1], q[:, None, 1:]
    twice = 2.0 * np.cross(v, points[None])
    return np.asarray(points[None] + w * twice + np.cross(v, twice))


@dataclass(frozen=True)
class Toss:
    """Recording of a toss from shortly before the first contact.

    Attributes:
        pose: Measured positions, m, and orientations (w, x, y, z), (samples, 7), or (samples, 8) with the angle of a hinge, rad.
        start: Initial state, (13,) or (15,): the first pose, velocity in world axes, m/s, and angular velocity in body axes, rad/s, and the
            rate of the hinge, rad/s.
        impact: Index of the sample before the first contact.
        fall: Acceleration of the flight before, m/s^2, downward.
    """

    pose: Array
    start: Array
    impact: int
    fall: float = G


def _angular_velocity(first: Array, last: Array, seconds: float) -> Array:
    """Mean angular velocity (3,) in body axes, rad/s, between two orientations (w, x, y, z)."""
    w, v = first[0] * last[0] + first[1:] @ last[1:], first[0] * last[1:] - last[0] * first[1:] - np.cross(first[1:], last[1:])
    if w < 0:
        w, v = -w, -v
    size = float(np.linalg.norm(v))
    return np.asarray(v * (2.0 * np.arctan2(size, w) / size if size > 1e-12 else 2.0) / seconds)


def _cut(pose: Array, velocity: Array, gravity: float) -> Toss:
    """Toss from three samples before the first possible contact; the initial velocity is fitted to the flight before, as published."""
    first = max(0, int(np.argmax(pose[:, 2] <= HALF * np.sqrt(3.0))) - 3)
    start = np.r_[pose[first], velocity[first]]
    if first >= 4:
        t = np.arange(first) * PERIOD
        line = np.linalg.lstsq(np.c_[np.ones(first), t], pose[:first, 2] + 0.5 * gravity * t**2, rcond=None)[0]
        start[7:9] = (pose[first - 1, :2] - pose[0, :2]) / t[-1]
        start[9] = line[1] - gravity * t[-1]
        start[10:] = _angular_velocity(pose[0, 3:], pose[first, 3:], PERIOD * first)
    corners = HALF * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    low = (rotated(pose[:, 3:], corners) + pose[:, None, :3])[..., 2].min(axis=1)[first:]
    return Toss(pose[first:], start, max(0, int(np.argmax(low < 0.002)) - 1))


def cube_tosses(folder: Path, gravity: float = G) -> list[Toss]:
    """All tosses of the data set `cube_toss` in a data folder.

    Raises:
        FileNotFoundError: The folder lacks the data set.
        ValueError: The archive is damaged.
    """
    arrays = data_set(folder, "cube_toss")
    start, pose, velocity = arrays["start"], arrays["pose"].astype(float), arrays["vel"].astype(float)
    return [_cut(pose[a:b], velocity[a:b], gravity) for a, b in itertools.pairwise(start)]


def free_fall(folder: Path, which: NDArray[np.int64]) -> float:
    """Median acceleration of the flights before the first contact, m/s^2, downward, with the nominal sample period."""
    arrays = data_set(folder, "cube_toss")
    found = []
    for k in which:
        pose = arrays["pose"][arrays["start"][k] : arrays["start"][k + 1]].astype(float)
        flight = int(np.argmax(pose[:, 2] <= HALF * np.sqrt(3.0)))
        if flight >= 12:
            found.append(-2.0 * np.polyfit(np.arange(flight) * PERIOD, pose[:flight, 2], 2)[0])
    return float(np.median(found))


def elbow_bodies(pose: Array) -> Array:
    """Positions, m, and orientations (w, x, y, z) of both links, (..., 2, 7), of poses (..., 8), which end with the hinge's angle, rad."""
    place, q = pose[..., :3], pose[..., 3:7] / np.linalg.norm(pose[..., 3:7], axis=-1, keepdims=True)
    cos, sin = np.cos(pose[..., 7] / 2.0), np.sin(pose[..., 7] / 2.0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    second = np.stack([w * cos - y * sin, x * cos - z * sin, w * sin + y * cos, z * cos + x * sin], axis=-1)
    flat, other = q.reshape(-1, 4), second.reshape(-1, 4)
    shift = rotated(flat, np.array([ELBOW_HINGE]))[:, 0] + rotated(other, np.array([ELBOW_CENTRE]))[:, 0]
    return np.stack([np.concatenate([place, q], -1), np.concatenate([place + shift.reshape(place.shape), second], -1)], axis=-2)


def elbow_tosses(folder: Path, _: float = G) -> list[Toss]:
    """Tosses of the data set `elbow_toss` in a data folder that begin with a free flight, from three samples before the first contact.

    The initial velocity is that of parabolas through ten samples of the flight. A flight is free if the mean of both centres falls with
    9.6 m/s^2 to within 1 m/s^2; others begin in the hand.
    """
    arrays, found = data_set(folder, "elbow_toss"), []
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * ELBOW_HALF
    for a, b in itertools.pairwise(arrays["start"]):
        pose = arrays["pose"][a:b].astype(float)
        pose[:, 7] = np.unwrap(pose[:, 7])
        bodies = elbow_bodies(pose).reshape(-1, 7)
        low = (rotated(bodies[:, 3:], corners)[..., 2].min(axis=1) + bodies[:, 2]).reshape(-1, 2).min(axis=1)
        touch = int(np.argmax(low < 0.008))
        if touch < 12:
            continue
        fall = -2.0 * np.polyfit(np.arange(touch) * PERIOD, bodies[: 2 * touch, 2].reshape(-1, 2).mean(axis=1), 2)[0]
        if abs(fall - 9.6) < 1.0:
            first, flight = touch - 3, pose[touch - 10 : touch]
            turns = np.array([_angular_velocity(pose[first, 3:7], q, 1.0) for q in flight[:, 3:7]])
            rates = np.polyfit(np.arange(-7, 3) * PERIOD, np.c_[flight[:, :3], turns, flight[:, 7]], 2)[1]
            found.append(Toss(pose[first : first + ELBOW_SAMPLES], np.r_[pose[first], rates], 2, float(fall)))
    return found


def data_set(folder: Path, name: str) -> dict[str, Any]:
    """Arrays of the archive NAME/NAME.npz of a data folder."""
    path = existing(folder / name / f"{name}.npz", f"{name} data")
    return dict(read_arrays(path, "data set"))
