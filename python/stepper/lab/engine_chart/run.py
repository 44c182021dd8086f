"""Measurements of a chart: errors of all engines, settings and time steps, and times in interleaved rounds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np

from stepper.lab.engine_chart.scenes import Scene
from stepper.lab.engines import Array, Engine, EngineBatch
from stepper.lab.timing import Timed


@dataclass(frozen=True)
class Effort:
    """Number and duration of the measurements.

    Attributes:
        repeats: Number of rounds. Each round times every engine with all its settings and time steps. The chart shows medians over rounds.
        seconds: Shortest duration of one measurement in a round, s.
        smallest: Smallest time step, s; smaller ones are left out.
    """

    repeats: int = 7
    seconds: float = 0.02
    smallest: float = 0.0

    @classmethod
    def quick(cls) -> Effort:
        """Small effort, for a rough chart in a few seconds."""
        return cls(repeats=3, seconds=0.004, smallest=2e-4)


@dataclass(frozen=True)
class Row:
    """Point of a chart: error and cost of an engine with given settings and a given time step.

    Attributes:
        scene: Name of the scene.
        engine: Name of the engine.
        setting: Name of the settings.
        dt: Time step, s.
        error: Error, in the unit of the scene's `error_label`; infinite if the run diverged.
        cost: Microseconds of one core per simulated second of one environment.
        step: Microseconds of one step of one environment.
        spread: Half the range of the repeated time measurements, relative to their median.
        slope: Order of convergence of the whole line, d log(error) / d log(dt); NaN with fewer than two usable errors.
    """

    scene: str
    engine: str
    setting: str
    dt: float
    error: float
    cost: float
    step: float
    spread: float
    slope: float = math.nan


@dataclass
class _Case(Timed):
    """Run of an engine on a scene with a given time step, with its error. The method `measure` times the run.

    Attributes:
        engine: The engine with its settings.
        dt: Time step, s.
        run: Batch of the engine.
        qpos, qvel: Initial positions (m, rad) and velocities (m/s, rad/s).
        nstep: Number of steps in the run.
        error: Error of the final positions, in the unit of the scene's `error_label`; infinite if the run diverged.
        times: Processor time of the run in each round, s.
    """

    engine: Engine
    dt: float
    run: EngineBatch
    qpos: Array
    qvel: Array
    nstep: int
    error: float
    times: list[float] = field(default_factory=list)

    def once(self) -> float:
        """Runs once from the start, and returns the processor time without the reset, s."""
        self.run.reset(self.qpos, self.qvel)
        begin = time.process_time()
        self.run.step(nstep=self.nstep)
        return time.process_time() - begin


def _prepare(scene: Scene, engine: Engine, dt: float) -> _Case:
    """Runs a scene once with an engine and a time step dt, s, to compute its error, and returns the run, which is not timed yet."""
    run = engine.start(scene.mjcf, dt)
    qpos, qvel = scene.start(run, dt)
    nstep = round(scene.duration / dt)
    run.reset(qpos, qvel)
    before = run.qpos[0]
    run.step(nstep=nstep)
    end = run.qpos[0]
    error = scene.error(before, end) if np.all(np.isfinite(end)) else math.inf
    return _Case(engine, dt, run, qpos, qvel, nstep, error)


def _row(scene: Scene, case: _Case) -> Row:
    """Point of the chart from a timed run, with the median of its measured times."""
    middle = median(case.times)
    micro = 1e6 / case.run.num_envs
    spread = 0.5 * (max(case.times) - min(case.times)) / middle
    cost, step = middle * micro / scene.duration, middle * micro / case.nstep
    return Row(scene.name, case.engine.engine, case.engine.setting, case.dt, case.error, cost, step, spread)


def slope(rows: Sequence[Row], floor: float = 1e-11, ceiling: float = 0.3) -> float:
    """Order of convergence of a line: slope of log(error) against log(dt), by least squares.

    Args:
        rows: Points of one engine and setting.
        floor: Errors below this are ignored, because they contain rounding and the error of the reference.
        ceiling: Errors above this are ignored, because they are outside the asymptotic range.

    Returns:
        The slope; NaN with fewer than two usable points.
    """
    usable = [(math.log(r.dt), math.log(r.error)) for r in rows if floor < r.error < ceiling]
    if len(usable) < 2:
        return math.nan
    x, y = np.array(usable).T
    return float(np.polyfit(x, y, 1)[0])


def _with_slopes(rows: list[Row]) -> list[Row]:
    """Copies of the chart's points in which `slope` is the order of convergence of the point's engine and settings."""
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        lines.setdefault((row.engine, row.setting), []).append(row)
    slopes = {line: slope(points) for line, points in lines.items()}
    return [replace(row, slope=slopes[row.engine, row.setting]) for row in rows]


def sweep(scene: Scene, effort: Effort | None = None, progress: Callable[[float], None] | None = None) -> list[Row]:
    """Runs every engine of a scene at every time step, and measures errors and times.

    A run makes all its steps in one call, so that the overhead of Python is negligible. Every round times all engines, settings and time
    steps, so that other load of the machine affects all of them equally. Call it inside `stepper.shared.machine.one_core()`.

    Args:
        scene: The scene.
        effort: Number and duration of the measurements; None selects the default.
        progress: Progress callback with the fraction done, 0 to 1.

    Returns:
        One row per engine, setting and time step, in that order.
    """
    effort = effort or Effort()
    steps = [dt for dt in scene.timesteps if dt >= effort.smallest]
    plan = [(engine, dt) for engine in scene.engines for dt in steps]
    total, done = len(plan) * (1 + effort.repeats), 0
    cases = []
    for engine, dt in plan:
        cases.append(_prepare(scene, engine, dt))
        done += 1
        if progress:
            progress(done / total)
    for _ in range(effort.repeats):
        for case in cases:
            case.measure(effort.seconds)
            done += 1
            if progress:
                progress(done / total)
    return _with_slopes([_row(scene, case) for case in cases])
