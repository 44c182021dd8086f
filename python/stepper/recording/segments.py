"""Segments of a recording as arrays. A segment has the state before consecutive calls of `step`, and their inputs and results."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.recording.format import HEADER, Arrays, read_header, read_rows, reading, warn_of_end
from stepper.recording.verify import recorded_stepper, repeat
from stepper.shared.arguments import path_of
from stepper.shared.fields import APPLIED

READ = ("qpos", "qvel", "act", "sensordata")
"""Recorded fields in `Segment.readings`."""


@dataclass(frozen=True)
class Segment:
    """Part of a recording with consecutive calls of `Stepper.step`. No reset, `set_state` or change of parameters lies between these calls.

    Attributes:
        model: The recorded model.
        row: Index of the segment's first row in the recording. A row is a recorded event, such as a call of `step`.
        period: Simulated time that a call of `step` advances, s.
        start: State before the first step: "qpos", "qvel", "act", (num_envs, ...).
        ctrl: Controls, (T, num_envs, nu).
        readings: "qpos", "qvel", "act" and "sensordata" after every call, (T, num_envs, ...).
        applied: Applied forces, mocap poses and active equalities by name, (T, num_envs, ...); names that were never set are absent.
    """

    model: Model
    row: int
    period: float
    start: dict[str, np.ndarray[Any, Any]]
    ctrl: np.ndarray[Any, Any]
    readings: dict[str, np.ndarray[Any, Any]]
    applied: dict[str, np.ndarray[Any, Any]]


def segments(path: str | os.PathLike[str]) -> Iterator[Segment]:
    """Yields the recorded arrays of a recording, one segment after the other.

        for segment in stepper.recording.segments("run"):
            qpos = segment.readings["qpos"]  # (T, num_envs, nq), after each call of step

    A change of the number of steps per call also starts a new segment.

    Warns:
        RecordingWarning: The recording was not closed.

    Raises:
        RecordingError: A file is missing or changed.
        OSError: A file cannot be read.
    """
    folder = path_of("path", path)
    head = read_header(folder)
    warn_of_end(folder, head)
    with reading(folder / HEADER):
        sim = recorded_stepper(folder, head)
    unapplied = {name: np.asarray(getattr(sim, name), np.float64) for name in APPLIED}
    applied: dict[str, np.ndarray[Any, Any]] = {}
    steps: list[Arrays] = []
    start, first = _state(sim), 0
    for row, (place, kind, arrays) in enumerate(read_rows(folder, head)):
        with reading(place):
            if steps and (kind not in ("step", "applied") or (kind == "step" and int(arrays["nstep"]) != int(steps[0]["nstep"]))):
                yield _segment(sim, first, start, steps, unapplied)
                steps = []
            if kind == "step":
                if not steps:
                    start, first = _state(sim), row
                steps.append(arrays | {f"applied/{name}": array for name, array in applied.items()})
                # Set the recorded state instead of repeating the step.
                shape = (lambda x: x) if sim.num_envs is not None else (lambda x: np.reshape(x, np.shape(x)[-1:]))
                sim.set_state(shape(arrays["qpos"]), shape(arrays["qvel"]), act=shape(arrays["act"]), keep_warmstart=True)
            elif kind == "applied":
                applied = {name: arrays[name] for name in APPLIED if name in arrays}
            else:
                repeat(sim, kind, arrays, row, 0)
                applied = {} if kind == "reset" else applied
    if steps:
        yield _segment(sim, first, start, steps, unapplied)


def _state(sim: Stepper) -> dict[str, np.ndarray[Any, Any]]:
    """Current qpos, qvel and act of a stepper by name, (num_envs, ...) float64."""
    n = sim.num_envs or 1
    return {name: np.asarray(getattr(sim, name), np.float64).reshape(n, -1) for name in ("qpos", "qvel", "act")}


def _segment(sim: Stepper, row: int, start: dict[str, Any], steps: list[Arrays], unapplied: dict[str, np.ndarray[Any, Any]]) -> Segment:
    """Segment of a recording from the arrays of its recorded calls of `Stepper.step`; `row` is the first among all recorded events.

    `unapplied` has initial values of applied forces, mocap poses and active equalities by name, for steps before these are set.
    """
    lead = (len(steps), sim.num_envs or 1)

    def stacked(name: str) -> np.ndarray[Any, Any]:
        return np.stack([np.asarray(step[name], np.float64) for step in steps]).reshape(*lead, -1)

    applied = {}
    for name in {name for step in steps for name in step if name.startswith("applied/")}:
        own = unapplied[name.removeprefix("applied/")]
        rows = [np.asarray(step.get(name, own), np.float64).reshape(own.shape) for step in steps]
        applied[name.removeprefix("applied/")] = np.stack(rows).reshape(*lead, *own.shape[sim.num_envs is not None :])
    return Segment(
        sim.model, row, int(steps[0]["nstep"]) * sim.timestep, start, stacked("ctrl"), {name: stacked(name) for name in READ}, applied
    )
