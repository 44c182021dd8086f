"""Cost of settings: processor time of one core for a simulated second of one environment, alone and in a batch."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from stepper.lab.accuracy.traces import Trace
from stepper.lab.study.batches import USUAL, steps_of, world_of
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import World

BATCH = 32
"""Number of environments of a timed batch: two SIMD groups with f32, four with f64."""
_PEER_BATCH = 4
"""Number of environments of a timed batch in MuJoCo, which steps one after the other: a larger batch costs the same per environment."""
_PAIRS, _PAIR_SECONDS = 8, 0.01
"""Number of rounds in which two settings are compared, and shortest duration of a round, s of processor time."""


class _Case:
    """Timed run of some settings with the controls and forces of a recorded run, so that only the steps are timed.

    Args:
        study: The study.
        settings: Settings, with the time step.
        trace: Recorded run.
        num_envs: Number of environments that are stepped together.

    Attributes:
        times: Mean processor time of the run in each round so far, s.
    """

    def __init__(self, study: Study, settings: Mapping[str, Any], trace: Trace, num_envs: int):
        self.world: World = world_of(study, USUAL, [study.nominal] * num_envs, **(dict(settings) | {"sensors": None}))
        self._nstep = steps_of(study, self.world.timestep)
        rows = np.arange(num_envs) % len(trace.qpos)
        self._qpos, self._qvel = trace.qpos[rows], trace.qvel[rows]
        self._ctrl, self._applied = trace.ctrl[:, rows], trace.applied[:, rows]
        self._pushes = bool(np.any(trace.applied))
        self._num_envs, self._study = num_envs, study
        self.times: list[float] = []

    def once(self) -> float:
        """Runs once, and returns the processor time of its steps, s."""
        world = self.world
        held = [bool(np.isnan(row).any()) for row in self._ctrl]
        world.start(self._qpos, self._qvel, self._study.keyframe, self._study.seed)
        total = 0.0
        for row, ctrl in enumerate(self._ctrl):
            if self._pushes:
                world.xfrc_applied[:] = self._applied[row]
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
        """Microseconds of one core for a simulated second of one environment."""
        return 1e6 * median(self.times) / (self._num_envs * len(self._ctrl) * self._study.control_period)


def costs(
    study: Study,
    settings: Sequence[Mapping[str, Any]],
    traces: Sequence[Trace],
    *,
    repeats: int,
    seconds: float,
    progress: Callable[[float], None] | None = None,
) -> list[tuple[float, float]]:
    """Measures the costs of settings, as medians over interleaved rounds. Call it inside `stepper.shared.machine.one_core()`.

    Args:
        study: The study; its threads are not used.
        settings: Settings of each timed case, by name, with the time step.
        traces: Recorded run of each case, whose controls are used.
        repeats: Number of rounds.
        seconds: Shortest time of a case in a round, s.
        progress: Progress callback with the fraction done.

    Returns:
        Cost of each case alone and in a batch, microseconds of one core for a simulated second of one environment.
    """
    sizes = [(1, _PEER_BATCH if own.get("engine", "stepper") != "stepper" else BATCH) for own in settings]
    cases = [_Case(study, settings[k], traces[k], n) for k, both in enumerate(sizes) for n in both]
    for done in range(repeats + 1):
        for case in cases:
            # The first round is not timed, because filling caches takes much of it.
            case.measure(seconds) if done else case.once()
        if progress:
            progress((done + 1) / (repeats + 1))
    return [(alone.cost, batch.cost) for alone, batch in zip(cases[::2], cases[1::2], strict=True)]


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
