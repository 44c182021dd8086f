"""Runs of a study's episodes with some settings: where every body is after every control, and how far two runs are apart."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.experiments.study.batches import drive_through, outcomes_of, world_of
from stepper.experiments.study.outcomes import Watch
from stepper.experiments.study.over_ray import each
from stepper.experiments.study.points import USUAL
from stepper.experiments.study.study import Study
from stepper.experiments.study.worlds import World

Array = NDArray[np.float64]

_UNITS = {"m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6), "rad": ("rad", 1.0), "mrad": ("rad", 1e-3)}
_UNITS |= {"deg": ("rad", np.pi / 180), "s": ("s", 1.0), "ms": ("s", 1e-3)}


@dataclass(frozen=True)
class Trace:
    """Episodes of one run.

    Attributes:
        time: After every control, s: (T,).
        points: Positions of bodies, geoms and sites, (T, episodes, nbody + ngeom + nsite, 3) in m; NaN from where an episode diverges.
        xquat: Orientations of the bodies, (T, episodes, nbody, 4); NaN likewise.
        ctrl: Controls, (T, episodes, nu); NaN where those in force were held.
        applied: Forces and torques on the bodies, (T, episodes, nbody, 6).
        qpos: Where episodes start, (episodes, nq).
        qvel: How fast, (episodes, nv).
        outcomes: By name, (episodes,).
        depth: Deepest overlap, m: (episodes,).
        residual: Largest one, m/s; NaN in MuJoCo: (episodes,).
        settings: In force.
        timestep: s.
    """

    time: Array
    points: Array
    xquat: Array
    ctrl: Array
    applied: Array
    qpos: Array
    qvel: Array
    outcomes: dict[str, Array]
    depth: Array
    residual: Array
    settings: dict[str, Any]
    timestep: float


def run(study: Study, episodes: Sequence[int], setting: str = USUAL, **changed: Any) -> Trace:
    """Runs episodes of the nominal point with ideal sensors, whose errors would depend on the time step.

    Args:
        study: The study.
        episodes: Their numbers.
        setting: Name of the settings.
        **changed: As of `world_of`.
    """
    world = world_of(study, setting, [study.nominal] * len(episodes), **(changed | {"sensors": None}))
    rows: list[tuple[float, Array, Array, Array, Array]] = []
    first: list[Array] = []
    watches: list[Watch] = []
    nu = world.model.nu

    def look(now: World) -> None:
        if not first:
            first.extend([now.qpos.copy(), now.qvel.copy()])
            watches.append(Watch(tuple(study.all_outcomes), now))
            return
        watches[0].look(now)
        held = np.full((now.num_envs, nu), np.nan)
        if now.last_ctrl is not None:
            held[:] = now.last_ctrl
        # Where MuJoCo began anew by itself, and stepper stands still, bodies have places that mean nothing.
        lost = now.diverged[:, None, None]
        points, xquat = np.where(lost, np.nan, _points(now)), np.where(lost, np.nan, now.xquat)
        rows.append((now.time, points, xquat, held, np.array(now.xfrc_applied, float)))

    drive_through(study, world, episodes, look)
    time, points, xquat, ctrl, applied = (np.array(column) for column in zip(*rows, strict=True))
    told = world.certificate()
    return Trace(
        time=time,
        points=points,
        xquat=xquat,
        ctrl=ctrl,
        applied=applied,
        qpos=first[0],
        qvel=first[1],
        outcomes=outcomes_of(watches[0], world),
        depth=told["depth"],
        residual=told["residual"],
        settings=world.settings(),
        timestep=world.timestep,
    )


def runs(
    study: Study, episodes: Sequence[int], settings: Sequence[Mapping[str, Any]], tick: Callable[[float], None] | None = None
) -> list[Trace]:
    """Runs of the same episodes with several settings, over Ray where the study says so.

    Args:
        study: The study.
        episodes: Their numbers.
        settings: As of `world_of`, of every run.
        tick: Called with the fraction done.
    """
    made: dict[int, Trace] = {}
    for number, trace in each(study, settings, functools.partial(_one, episodes)):
        made[number] = trace
        if tick:
            tick(len(made) / len(settings))
    return [made[number] for number in range(len(settings))]


def _one(episodes: Sequence[int], study: Study, settings: Mapping[str, Any]) -> Trace:
    return run(study, episodes, **settings)


def _points(now: World) -> Array:
    # Origins of bodies alone would not see a link that turns about its own: geoms and sites are farther out.
    return np.concatenate([now.xpos, now.geom_xpos, now.site_xpos], axis=1)


@dataclass(frozen=True)
class Distance:
    """How far two runs are apart: the largest distance of a body, geom or site, in m, or angle of a body, in rad, up to a horizon.

    Attributes:
        unit: "m" or "rad".
        horizon: s.
    """

    unit: str
    horizon: float

    def over_time(self, one: Trace, other: Trace) -> Array:
        """Largest so far, after every control: (T, episodes); infinite where a run is not finite."""
        if self.unit == "m":
            apart = np.linalg.norm(one.points - other.points, axis=3)
        else:
            # By the vector part of the difference: 1 - cos loses half of the digits.
            product = _between(one.xquat, other.xquat)
            apart = 2.0 * np.arctan2(np.linalg.norm(product[..., 1:], axis=3), np.abs(product[..., 0]))
        far: Array = np.where(np.isfinite(apart), apart, np.inf).max(axis=2)
        return np.maximum.accumulate(far, axis=0)

    def __call__(self, one: Trace, other: Trace) -> Array:
        """Largest up to the horizon, (episodes,)."""
        last = int(np.searchsorted(one.time, self.horizon * (1 + 1e-9), side="right"))
        at: Array = self.over_time(one, other)[max(0, last - 1)]
        return at


def _between(a: Array, b: Array) -> Array:
    """conj(a) b of unit quaternions (w, x, y, z)."""
    w, v = a[..., :1], -a[..., 1:]
    x, u = b[..., :1], b[..., 1:]
    return np.concatenate([w * x - (v * u).sum(axis=-1, keepdims=True), w * u + x * v + np.cross(v, u)], axis=-1)


def quantity(given: str | float, *, name: str, units: Sequence[str]) -> tuple[float, str]:
    """A number with its unit, e.g. "1 mm": (1e-3, "m"). A plain number is of the base unit, where there is one alone.

    Args:
        given: The words, or the number.
        name: What errors call it.
        units: Base units that it may have: of "m", "rad", "s".

    Raises:
        ValueError: It is none.
    """
    known = [unit for unit, (base, _) in _UNITS.items() if base in units]
    if isinstance(given, int | float | np.number) and not isinstance(given, bool) and len(units) == 1:
        if 0 < given < np.inf:
            return float(given), units[0]
    elif isinstance(given, str):
        found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*([a-z]+)\s*", given)
        with contextlib.suppress(ValueError):
            if found and found[2] in known and 0 < float(found[1]) < np.inf:
                base, factor = _UNITS[found[2]]
                return float(found[1]) * factor, base
    raise ValueError(
        f'{name} is {given!r}, must be a number above 0 with a unit, such as "1 {known[-1]}"; units are: {", ".join(known)}'
        + (f"; without a unit a number is in {units[0]}" if len(units) == 1 else "")
    )
