"""Recorded runs of a study's episodes, and distances between runs.

A trace has the positions of all bodies after every control period. It is shorter if the run took too long. From the first state of an
episode that is not finite, the trace has NaN for this episode.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.batches import USUAL, running, world_of
from stepper.lab.study.outcomes import Watch
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import StepperWorld, World

Array = NDArray[np.float64]

_UNITS = {"m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6), "rad": ("rad", 1.0), "mrad": ("rad", 1e-3)}
_UNITS |= {"deg": ("rad", np.pi / 180), "s": ("s", 1.0), "ms": ("s", 1e-3)}
"""Base unit of each unit, and the unit as a multiple of the base unit."""


@dataclass(frozen=True)
class Trace:
    """Record of a run of several episodes.

    Attributes:
        time: Times at the ends of control periods, (T,), s. T is smaller than the study's number of control periods if the run was stopped.
        points: Positions of bodies, geoms and sites, (T, episodes, nbody + ngeom + nsite, 3), m; NaN from the first state of an episode
            that is not finite.
        xquat: Orientations of the bodies, (T, episodes, nbody, 4), quaternions (w, x, y, z).
        ctrl: Controls, (T, episodes, nu); NaN where the controller kept the previous controls.
        applied: Forces (N) and torques (N m) on the bodies, (T, episodes, nbody, 6).
        qpos: Initial positions, (episodes, nq), m and rad.
        qvel: Initial velocities, (episodes, nv), m/s and rad/s.
        path: Positions, (T, episodes, nq), m and rad, and velocities, (T, episodes, nv), m/s and rad/s, at the ends of control periods; NaN
            from the first state of an episode that is not finite.
        finite: Whether each episode was finite to the end of the run, (episodes,).
        outcomes: Outcomes by name, (episodes,); NaN if the run was stopped or is not finite.
        depth: Deepest overlap, (episodes,), m.
        residual: Largest residual, (episodes,), m/s; NaN in MuJoCo.
        settings: All settings of the engine.
        timestep: Time step, s.
        spent: Processor time of the run, s.
        stopped: Whether the run was stopped because it took too long.
    """

    time: Array
    points: Array
    xquat: Array
    ctrl: Array
    applied: Array
    qpos: Array
    qvel: Array
    path: tuple[Array, Array]
    finite: NDArray[np.bool_]
    outcomes: dict[str, Array]
    depth: Array
    residual: Array
    settings: dict[str, Any]
    timestep: float
    spent: float
    stopped: bool

    @property
    def reached(self) -> float:
        """Simulated time at the end of the run, s."""
        return float(self.time[-1]) if len(self.time) else 0.0


def run(
    study: Study,
    episodes: Sequence[int],
    setting: str = USUAL,
    *,
    until: float = math.inf,
    patience: float = math.inf,
    progress: Callable[[float], None] | None = None,
    **changed: Any,
) -> Trace:
    """Runs episodes with nominal parameters. Sensors are ideal, because sensor errors would depend on the time step.

    Args:
        study: The study.
        episodes: Numbers of the episodes.
        setting: Name of the settings.
        until: Simulated time of the run, s; outcomes are NaN if it is shorter than an episode.
        patience: Processor time after which the run is stopped, s. The limit is checked between two steps, but in MuJoCo only between two
            control periods.
        progress: Progress callback, called with the fraction done after every control period.
        **changed: Settings that differ from the study's, by name, such as timestep=0.001 or engine="mujoco".
    """
    begun = time.process_time()
    world = world_of(study, setting, [study.nominal] * len(episodes), **(changed | {"sensors": None}))
    seen = TraceRecorder(study, world)
    by_step = math.isfinite(patience) and world.engine == "stepper"
    enough = (
        max(1, min(study.num_control_steps, math.ceil(until / study.control_period - 1e-9)))
        if math.isfinite(until)
        else study.num_control_steps
    )
    for looks in running(study, world, episodes, by_step=by_step):
        if looks:
            seen.record(world)
            if progress:
                progress(len(seen.rows) / enough)
            if len(seen.rows) >= enough < study.num_control_steps or not seen.finite.any():
                break
        if time.process_time() - begun > patience:
            break
    return seen.trace(world, enough, time.process_time() - begun)


class TraceRecorder:
    """Recorder that builds the trace of a run. Call `record` at the start and after every control period."""

    def __init__(self, study: Study, world: World):
        self._study, self._nu = study, world.model.nu
        self.rows: list[tuple[float, tuple[Array, ...], Array, Array]] = []
        self.finite: NDArray[np.bool_] = np.ones(world.num_envs, np.bool_)
        self._start: tuple[Array, Array] | None = None
        self._watch: Watch | None = None

    def record(self, now: World) -> None:
        """Records the initial state in the first call, and the state after a control period in later calls."""
        if self._watch is None or self._start is None:
            self._start, self._watch = (now.qpos.copy(), now.qvel.copy()), Watch(tuple(self._study.all_outcomes), now)
            return
        self._watch.record(now)
        held = np.full((now.num_envs, self._nu), np.nan)
        if now.last_ctrl is not None:
            held[:] = now.last_ctrl
        shown = (_points(now), now.xquat.copy(), now.qpos.copy(), now.qvel.copy())
        sound = np.isfinite(shown[2]).all(axis=1) & np.isfinite(shown[3]).all(axis=1)
        self.finite &= sound & ~now.diverged
        lost = ~self.finite
        for array in shown:
            array[lost] = np.nan
        self.rows.append((float(now.time[0]), shown, held, np.array(now.xfrc_applied, float)))
        if lost.any() and isinstance(now, StepperWorld):
            # Diverged environments are reset, because they would use all iterations in every step.
            now.sim.reset(lost, qpos=self._start[0], qvel=self._start[1])

    def trace(self, world: World, controls: int, spent: float) -> Trace:
        """Trace of the run. Outcomes are NaN for episodes that were not finite or did not run to their end."""
        assert self._start is not None
        assert self._watch is not None
        worst, model, count = world.solver_quality(), world.model, len(self.rows)
        shapes = ((model.nbody + model.ngeom + model.nsite, 3), (model.nbody, 4), (model.nq,), (model.nv,))
        over = [np.array([row[1][k] for row in self.rows], float).reshape(count, world.num_envs, *shape) for k, shape in enumerate(shapes)]
        lost = ~self.finite if count == self._study.num_control_steps else np.ones(world.num_envs, np.bool_)
        return Trace(
            time=np.array([row[0] for row in self.rows]),
            points=over[0],
            xquat=over[1],
            ctrl=np.array([row[2] for row in self.rows]).reshape(count, world.num_envs, self._nu),
            applied=np.array([row[3] for row in self.rows]).reshape(count, world.num_envs, model.nbody, 6),
            qpos=self._start[0],
            qvel=self._start[1],
            path=(over[2], over[3]),
            finite=self.finite,
            outcomes={name: np.where(lost, np.nan, value) for name, value in self._watch.values(world).items()},
            depth=worst["max_penetration"],
            residual=worst["residual"],
            settings=world.settings(),
            timestep=world.timestep,
            spent=spent,
            stopped=bool(count < controls and self.finite.any()),
        )


def posed(study: Study, qpos: Array, like: Trace) -> Trace:
    """Trace with the poses of given positions, (episodes, control periods, nq), m and rad, at the times of another trace."""
    world = world_of(study, USUAL, [study.nominal] * len(qpos), sensors=None)
    assert isinstance(world, StepperWorld)
    shown = []
    for row in np.moveaxis(qpos, 1, 0)[: len(like.time)]:
        world.sim.set_state(row)
        shown.append((_points(world), world.xquat.copy()))
    points, xquat = map(np.array, zip(*shown, strict=True))
    return replace(like, time=like.time[: len(shown)], points=points, xquat=xquat, finite=np.ones(len(qpos), np.bool_), stopped=False)


def runs(
    study: Study,
    episodes: Sequence[int],
    settings: Sequence[Mapping[str, Any]],
    patience: Sequence[float],
    progress: Callable[[float], None] | None = None,
) -> list[Trace]:
    """Traces of the same episodes with several settings, each stopped after a limit of processor time, `patience`, s."""
    made: list[Trace] = []
    for own, seconds in zip(settings, patience, strict=True):
        made.append(run(study, episodes, patience=seconds, **own))
        if progress:
            progress(len(made) / len(settings))
    return made


def _points(now: World) -> Array:
    """Points whose distances between two runs are the errors, (num_envs, n, 3) m: origins of bodies, geoms and sites."""
    # The origin of a body does not move when the body turns about it; geoms and sites do.
    return np.concatenate([now.xpos, now.geom_xpos, now.site_xpos], axis=1)


@dataclass(frozen=True)
class Distance:
    """Measure of the error between two runs. A call with the two runs computes the error.

    It is the largest distance between the positions of a body, geom or site in the two runs (m), up to a horizon. With the unit "rad" it is
    the largest angle between the orientations of a body.

    Attributes:
        unit: "m" or "rad".
        horizon: Simulated time up to which differences count, s.
    """

    unit: str
    horizon: float

    def over_time(self, one: Trace, other: Trace) -> Array:
        """Largest difference of two runs up to the end of each control period, (T, episodes), m or rad; infinite if a run is not finite."""
        seen = min(len(one.time), len(other.time))
        if self.unit == "m":
            apart = np.linalg.norm(one.points[:seen] - other.points[:seen], axis=3)
        else:
            # The angle comes from the vector part of the quaternion between the orientations, because 1 - cos loses half of the digits.
            product = _between(one.xquat[:seen], other.xquat[:seen])
            apart = 2.0 * np.arctan2(np.linalg.norm(product[..., 1:], axis=3), np.abs(product[..., 0]))
        far: Array = np.where(np.isfinite(apart), apart, np.inf).max(axis=2)
        return np.maximum.accumulate(far, axis=0)

    def __call__(self, one: Trace, other: Trace) -> Array:
        """Largest difference up to the horizon, (episodes,), m or rad.

        It is NaN if a run was stopped before the horizon, and infinite if a run is not finite.
        """
        short, long = sorted((one, other), key=lambda trace: len(trace.time))
        last = max(1, int(np.searchsorted(long.time, self.horizon * (1 + 1e-9), side="right")))
        far = self.over_time(one, other)
        if last <= len(far):
            at: Array = far[last - 1]
            return at
        return np.where(short.finite, np.nan, np.inf)


def _between(a: Array, b: Array) -> Array:
    """Rotation from a to b as a quaternion: product conj(a) b of unit quaternions (w, x, y, z), (..., 4)."""
    w, v = a[..., :1], -a[..., 1:]
    x, u = b[..., :1], b[..., 1:]
    return np.concatenate([w * x - (v * u).sum(axis=-1, keepdims=True), w * u + x * v + np.cross(v, u)], axis=-1)


def quantity(given: str | float, *, name: str, units: Sequence[str]) -> tuple[float, str]:
    """Parses a quantity: "1 mm" gives its value in the base unit, and the base unit: (1e-3, "m")."""
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
    example = "0.5 s" if units == ("s",) else "1 mm" if "m" in units else "0.5 deg"
    raise ValueError(f'{name} is {given!r}, must be a number above 0 with a unit, such as "{example}"; units are: {", ".join(known)}')
