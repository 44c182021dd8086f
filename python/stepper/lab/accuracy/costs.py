"""Cost of settings: processor time of one core for a simulated second of one environment, alone and in a batch."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from stepper.lab.accuracy.budget import Stage
from stepper.lab.accuracy.traces import Trace
from stepper.lab.study.batches import steps_of, world_of
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import World

BATCH = 32
"""Number of environments of a timed batch: two SIMD groups with f32, four with f64."""
_PEER_BATCH = 4
"""Number of environments of a timed batch in MuJoCo, which steps one after the other: a larger batch costs the same per environment."""
_LONG_RUN = 0.1
"""Processor time above which a run's first repetition counts as a measurement if there is a time budget, s.

In shorter runs, filling caches takes much of the time.
"""

_PAIRS, _PAIR_SECONDS = 8, 0.01
"""Number of rounds in which two settings are compared, and shortest duration of a round, s of processor time."""


class _Case:
    """Timed run of some settings with the controls and forces of a recorded run, so that only the steps are timed.

    Args:
        study: The study.
        settings: Settings, with the time step.
        trace: Recorded run.
        num_envs: Number of environments that are stepped together.
        stage: Stage of the time budget; None sets no time limit.

    Attributes:
        times: Mean processor time of the run in each round so far, s.
    """

    def __init__(self, study: Study, settings: Mapping[str, Any], trace: Trace, num_envs: int, stage: Stage | None = None):
        self.world: World = world_of(study, USUAL, [study.nominal] * num_envs, **(dict(settings) | {"sensors": None}))
        self._nstep = steps_of(study, self.world.timestep)
        rows = np.arange(num_envs) % len(trace.qpos)
        self._qpos, self._qvel = trace.qpos[rows], trace.qvel[rows]
        self._ctrl, self._applied = trace.ctrl[:, rows], trace.applied[:, rows]
        self._pushes = bool(np.any(trace.applied))
        self._num_envs, self._study, self._stage = num_envs, study, stage or Stage()
        self.times: list[float] = []

    def once(self) -> float:
        """Runs once, and returns the processor time of its steps, s; infinite if the time budget ended it."""
        world = self.world
        held = [bool(np.isnan(row).any()) for row in self._ctrl]
        world.start(self._qpos, self._qvel, self._study.keyframe, self._study.seed)
        total = 0.0
        for row, ctrl in enumerate(self._ctrl):
            if self._pushes:
                world.xfrc_applied[:] = self._applied[row]
            if self._stage.limited and not self._stage.left:
                return math.inf
            given = None if held[row] or not ctrl.size else ctrl
            begin = time.process_time()
            world.step(given, self._nstep)
            total += time.process_time() - begin
        return total

    def measure(self, seconds: float) -> None:
        """Measures one round: repeats the run for at least `seconds`, and appends the mean processor time to `times`."""
        runs, total = 0, 0.0
        while total < seconds:
            total += self.once()
            runs += 1
        self.times.append(total / runs)

    @property
    def cost(self) -> float:
        """Microseconds of one core for a simulated second of one environment; NaN if the time budget ended before the first measurement."""
        times = [own for own in self.times if math.isfinite(own)]
        return 1e6 * median(times) / (self._num_envs * len(self._ctrl) * self._study.control_period) if times else math.nan


def costs(
    study: Study,
    settings: Sequence[Mapping[str, Any]],
    traces: Sequence[Trace],
    *,
    repeats: int,
    seconds: float,
    progress: Callable[[float], None] | None = None,
    stage: Stage | None = None,
) -> list[tuple[float, float]]:
    """Measures the costs of settings, as medians over interleaved rounds. Call it inside `stepper.shared.machine.one_core()`.

    Args:
        study: The study; its threads are not used.
        settings: Settings of each timed case, by name, with the time step.
        traces: Recorded run of each case, whose controls are used.
        repeats: Number of rounds.
        seconds: Shortest time of a case in a round, s.
        progress: Progress callback with the fraction done.
        stage: Stage of the time budget. Cases without a measurement before its end get the cost NaN. None sets no time limit.

    Returns:
        Cost of each case alone and in a batch, microseconds of one core for a simulated second of one environment.
    """
    stage = stage or Stage()
    sizes = [(1, _PEER_BATCH if own.get("engine", "stepper") != "stepper" else BATCH) for own in settings]
    # Single environments and the study's time step come first, so that they are done for all settings if the budget ends early.
    usual = study.options.timestep or float(study.loaded[0].timestep)
    far = [abs(math.log(float(own.get("timestep") or usual) / usual)) for own in settings]
    order = sorted(((n, k) for k, both in enumerate(sizes) for n in enumerate(both)), key=lambda own: (own[0][0], far[own[1]]))
    cases: dict[tuple[int, int], _Case] = {}
    for done, ((which, n), k) in enumerate(order):
        if stage.limited and not stage.left:
            break
        case = cases[k, which] = _Case(study, settings[k], traces[k], n, stage)
        first = case.once()
        if stage.limited:
            # If the budget ends soon, this stays the only measurement of the case.
            case.times.append(first) if first >= _LONG_RUN else case.measure(seconds)
        if progress:
            progress((done + 1) / len(order) / (repeats + 1))
    for done in range(repeats):
        for case in cases.values():
            if stage.limited and not stage.left:
                break
            case.measure(seconds)
        if progress:
            progress((done + 2) / (repeats + 1))
    spent = {key: case.cost for key, case in cases.items()}
    return [(spent.get((k, 0), math.nan), spent.get((k, 1), math.nan)) for k in range(len(settings))]


def saving(own: tuple[Study, Mapping[str, Any]], less: tuple[Study, Mapping[str, Any]], trace: Trace) -> tuple[float, float]:
    """Measures the fraction of a batch's time that one study or setting saves compared with another, in rounds that run both.

    Call it inside `stepper.shared.machine.one_core()`.

    Args:
        own: Study, and settings by name (such as timestep=0.001) that differ from it: the baseline.
        less: Study and settings that may take less time.
        trace: Recorded run whose controls are used.

    Returns:
        Median fraction, and its lower bound: the second smallest of eight rounds. The true median is below it in 3.5 % of cases.
    """
    cases = [_Case(study, settings, trace, BATCH) for study, settings in (own, less)]
    for case in cases:
        case.once()
    for _ in range(_PAIRS):
        for case in cases:
            case.measure(_PAIR_SECONDS)
    shares = sorted(1.0 - b / a for a, b in zip(*(case.times for case in cases), strict=True))
    return median(shares), shares[1]
