"""What settings cost: processor time of one core for a simulated second of one environment, alone and in a batch."""

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
from stepper.lab.timing import Timed

BATCH = 32
"""Environments of a batch: two groups of lanes in 32 bits, four in 64."""
_APART = 4
"""Environments of a batch of MuJoCo and rapier, which step one after the other, so that more tell no more."""
_LONG = 0.1
"""Processor seconds from which on a run that nothing warmed counts: caches are filled in thousandths of one."""

_PAIRS, _PAIR_SECONDS = 8, 0.01
"""Rounds in which two are compared, and processor seconds of one in each, at the least."""


class _Case(Timed):
    """A run that is repeated: recorded controls and forces, so that nothing but steps is timed."""

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
        """Processor seconds of the steps of one run; infinite where the clock ended it before."""
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

    @property
    def cost(self) -> float:
        """Microseconds for a simulated second of one environment; NaN where the clock left no time for it."""
        times = [own for own in self.times if math.isfinite(own)]
        return 1e6 * median(times) / (self._num_envs * len(self._ctrl) * self._study.hold) if times else math.nan


def costs(
    study: Study,
    settings: Sequence[Mapping[str, Any]],
    traces: Sequence[Trace],
    *,
    repeats: int,
    seconds: float,
    tick: Callable[[float], None] | None = None,
    stage: Stage | None = None,
) -> list[tuple[float, float]]:
    """Costs of settings. Rounds are interleaved; medians count. Call it inside `stepper.shared.machine.one_core()`.

    Args:
        study: The study; its threads are not read.
        settings: Of each case, with its time step.
        traces: What each did, whose controls are repeated.
        repeats: Rounds.
        seconds: Least time of a case in a round, s.
        tick: Called with the fraction done.
        stage: When it has to be done: rounds end with it, and what no round has got to costs NaN; None is never.

    Returns:
        (alone, in a batch) in microseconds for a simulated second of one environment, of each settings.
    """
    stage = stage or Stage()
    sizes = [(1, _APART if own.get("engine", "stepper") != "stepper" else BATCH) for own in settings]
    # Alone first, and the study's own time step: where the clock ends it, all settings have that before some have more.
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
            # Later rounds may not come.
            case.times.append(first) if first >= _LONG else case.measure(seconds)
        if tick:
            tick((done + 1) / len(order) / (repeats + 1))
    for done in range(repeats):
        for case in cases.values():
            if stage.limited and not stage.left:
                break
            case.measure(seconds)
        if tick:
            tick((done + 2) / (repeats + 1))
    spent = {key: case.cost for key, case in cases.items()}
    return [(spent.get((k, 0), math.nan), spent.get((k, 1), math.nan)) for k in range(len(settings))]


def saving(own: tuple[Study, Mapping[str, Any]], less: tuple[Study, Mapping[str, Any]], trace: Trace) -> tuple[float, float]:
    """Share of the time of a batch that a study with some settings saves beside another one, of rounds in each of which both run.

    Call it inside `stepper.shared.machine.one_core()`.

    Args:
        own: A study, and settings as of `world_of`.
        less: What may take less time.
        trace: Whose controls are repeated.

    Returns:
        The median, and its lower bound: the second least of eight, below which it is in nine of 256 cases (3.5 %).
    """
    cases = [_Case(study, settings, trace, BATCH) for study, settings in (own, less)]
    for case in cases:
        case.once()
    for _ in range(_PAIRS):
        for case in cases:
            case.measure(_PAIR_SECONDS)
    shares = sorted(1.0 - b / a for a, b in zip(*(case.times for case in cases), strict=True))
    return median(shares), shares[1]
