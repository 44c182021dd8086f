"""Verification of a recording: repeats all calls and compares the results bit for bit."""

from __future__ import annotations

import json
import operator
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from stepper._options import Options, precision_of
from stepper._stepper import Model, State, Stepper, __version__
from stepper.actuators import ActuatorModel
from stepper.recording.format import COMPARED, HEADER, MODEL, ROWS, Arrays, Header, RecordingError, read_header, read_rows, reading
from stepper.sensors import SensorModel
from stepper.shared.arguments import path_of
from stepper.shared.fields import APPLIED
from stepper.shared.progress import ProgressCallback, silent

_LEAST_NUMBER = 4
"""Least size of a number of qpos and qvel in a state, bytes."""
_REJECTED = 100_000
"""Largest number of steps of a recorded call in which no environment's time may advance (see `Status.NON_FINITE`)."""


@dataclass(frozen=True)
class Difference:
    """First field of a step that differs between a recording and its replay.

    Attributes:
        row: Index of the row in the recording.
        step: Index of the call of `step`, from 0.
        field: Name of the field that differs.
        env: Index of the first environment that differs; 0 with `num_envs=None`.
        recorded: Recorded values of the field in that environment, in its unit.
        replayed: Values of the field in the replay.
    """

    row: int
    step: int
    field: str
    env: int
    recorded: np.ndarray[Any, Any]
    replayed: np.ndarray[Any, Any]

    def __str__(self) -> str:
        where = f"call {self.step} of step (row {self.row}), environment {self.env}: {self.field}"
        return f"{where} was {self.recorded.tolist()}, is {self.replayed.tolist()}"


@dataclass(frozen=True)
class Verification:
    """Result of a replay. Its truth value is True if all results are identical bit for bit.

    Attributes:
        rows: Number of recorded events (rows) that were repeated.
        steps: Number of calls of `step` that were repeated.
        difference: First difference; None if there is none.
        complete: Whether the recording was closed; otherwise the events of its last second may be missing.
        versions: Version of stepper that made the recording, and the current one. Only equal versions guarantee identical results.
    """

    rows: int
    steps: int
    difference: Difference | None
    complete: bool
    versions: tuple[str, str]

    def __bool__(self) -> bool:
        """Whether all results are identical bit for bit."""
        return self.difference is None

    def __str__(self) -> str:
        end = "" if self.complete else "; the recording was not closed, its last second may be missing"
        recorded, here = self.versions
        if recorded != here:
            end += f"; recorded by stepper {recorded}, replayed by {here}"
        if self.steps == 0:
            return f"nothing to compare: no call of step was recorded{end}"
        if self.difference is None:
            return f"{self.steps} calls of step in {self.rows} rows reproduced, bit for bit{end}"
        return f"differs at {self.difference}{end}"


def verify(path: str | os.PathLike[str], *, threads: int | None = None, progress: ProgressCallback | None = None) -> Verification:
    """Repeats a recording and compares states, sensor readings, residuals and flags bit for bit, up to the first difference.

    Args:
        path: Folder that `Stepper.record` wrote.
        threads: Number of threads; None uses the recorded number. Results do not depend on it.
        progress: Function that is called with "replay" and the fraction of the recorded events that were repeated.

    Raises:
        TypeError, ValueError: `threads` is invalid.
        RecordingError: The recording has no events, or a file is missing or changed.
        OSError: A file cannot be read.
        MemoryError: There is not enough memory for the environments.
    """
    if threads is not None and operator.index(threads) < 0:
        raise ValueError(f"threads is {threads}, must be a whole number, 0 or more")
    folder = path_of("path", path)
    head = read_header(folder)
    with reading(folder / HEADER):
        sim = recorded_stepper(folder, head, threads)
        versions = (head["provenance"]["versions"]["stepper"], __version__)
    rows = steps = 0
    for place, kind, arrays in read_rows(folder, head):
        with reading(place):
            difference = repeat(sim, kind, arrays, rows, steps)
        rows, steps = rows + 1, steps + (kind == "step")
        if difference:
            return Verification(rows, steps, difference, head["closed"], versions)
        # A recording that was not closed may have more rows than run.json counts.
        (progress or silent)("replay", min(rows / max(head["rows"], 1), 1.0))
    return Verification(rows, steps, None, head["closed"], versions)


def recorded_stepper(folder: Path, head: Header, threads: int | None = None) -> Stepper:
    """New stepper with the model and settings of a recording.

    Args:
        folder: Folder of the recording.
        head: Contents of its run.json.
        model: Model that must equal the recorded one; None skips this check.
        threads: Number of threads; None uses the recorded number.
    """
    with reading(folder / MODEL):
        own = Model.from_file(folder / MODEL)
    if own.digest != head["model"]["sha256"]:
        name, digest = head["model"]["name"], head["model"]["sha256"][:12]
        raise RecordingError(f'{folder} was recorded with model "{name}" {digest}, and the model in its folder is {own.digest[:12]}')
    if differ := head["options"].keys() ^ {field.name for field in fields(Options)}:
        raise RecordingError(
            f"{folder / HEADER}: its options differ in {', '.join(sorted(differ))}; replay it with the version that recorded it"
        )
    _check_num_envs(folder, head, own)
    return Stepper(
        own,
        head["num_envs"],
        options=Options(**head["options"]),
        precision=precision_of(head["precision"]),
        threads=min(operator.index(head["threads"]), os.cpu_count() or 1) if threads is None else threads,
        seed=head["seed"],
        actuators=None if head["actuators"] is None else ActuatorModel.from_dict(head["actuators"], str(folder)),
        sensors=None if head["sensors"] is None else SensorModel.from_dict(head["sensors"], str(folder)),
    )


def _check_num_envs(folder: Path, head: Header, model: Model) -> None:
    """Raises RecordingError if a recording has no events, or more environments in run.json than in the state of its first event.

    With a damaged file, the replay could otherwise take all memory.
    """
    place, kind, arrays = next(read_rows(folder, head), (str(folder / ROWS), "", {}))
    if kind != "start":
        raise RecordingError(f"{place}: the recording does not begin with a start: its process was stopped before the first event")
    with reading(place):
        size, least = arrays["state"].nbytes, _LEAST_NUMBER * (model.nq + model.nv) * (head["num_envs"] or 1)
    if size < max(least, head["num_envs"] or 1):
        raise RecordingError(
            f"{folder / HEADER}: num_envs is {head['num_envs']}, but the state in the first row has {size} bytes; copy the recording again"
        )


def _check_nstep(sim: Stepper, nstep: int, time: np.ndarray[Any, Any]) -> None:
    """Raises ValueError if a recorded call of `step` has many more steps than the recorded time (num_envs,) after it allows.

    With a damaged file, the replay could otherwise run endlessly. Time does not advance in steps without a finite state.
    """
    advance = float(np.max(time - np.asarray(sim.time)))
    if not nstep <= advance / sim.timestep + _REJECTED:
        raise ValueError(f"nstep is {nstep}, but the recorded time advances by {advance:g} s, at a time step of {sim.timestep:g} s")


def repeat(sim: Stepper, kind: str, arrays: Arrays, row: int, step: int) -> Difference | None:
    """Repeats the event in one row of a recording, such as a call of `step`.

    Args:
        sim: Stepper in the state before the row.
        kind: Kind of the row, such as "step".
        arrays: Arguments and recorded results of the row.
        row: Index of the row.
        step: Index of the call of `step`.

    Returns:
        First difference between the result of a step and the recorded result. None if the results are identical, or the row is not a step.
    """
    if (kind == "start") != (row == 0):
        raise ValueError(f"the row has kind {kind}; the first row of a recording must have kind start, and no other row may")
    if kind == "step":
        ctrl = arrays["ctrl"] if sim.num_envs is not None else arrays["ctrl"][0]
        _check_nstep(sim, int(arrays["nstep"]), arrays["time"])
        sim.step(ctrl, nstep=int(arrays["nstep"]))
        return _compare(sim, arrays, row, step)
    if kind == "start" or (kind == "set_state" and "state" in arrays):
        apply_parameters(sim, arrays)
        sim.set_state(State(arrays["state"].tobytes()))
    elif kind == "set_state":
        kept = bool(arrays.pop("keep_warmstart", False))
        sim.set_state(**arrays, keep_warmstart=kept)
    elif kind == "randomize":
        apply_parameters(sim, arrays)
    elif kind == "reset":
        word, number = arrays.pop("keyframe", None), arrays.pop("seed", None)
        keyframe = None if word is None else word.item()
        seed = int(number) if number is not None and number.ndim == 0 else number
        sim.reset(**arrays, keyframe=keyframe, seed=seed)
    else:
        for name in APPLIED:
            if name in arrays:
                setattr(sim, name, arrays[name])
    return None


def apply_parameters(sim: Stepper, arrays: Arrays) -> None:
    """Sets the recorded parameters of environments in a stepper.

    `arrays` has the arrays of one row of the recording, by name. The row is the start of the recording or a call of `Stepper.randomize`.
    The arrays contain values of the changed environments only.
    """
    rows = {name.removeprefix("randomized/"): values for name, values in arrays.items() if name.startswith("randomized/")}
    n = sim.num_envs or 1
    mask = arrays.get("envs", np.full(n, True))
    drawn: dict[str, np.ndarray[Any, Any] | ActuatorModel | None] = {str(name): None for name in arrays.get("shared", ())}
    for name, values in rows.items():
        shape = np.shape(getattr(sim.model, name))
        full = np.zeros((n, *shape))
        full[mask] = values.reshape(len(values), *shape)
        drawn[name] = full if sim.num_envs is not None else full[0]
    if "actuators" in arrays:
        drawn["actuators"] = ActuatorModel.from_dict(json.loads(str(arrays["actuators"]))).spread(mask)
    if drawn or "envs" in arrays:
        sim.randomize(None, mask, **drawn)


def _compare(sim: Stepper, arrays: Arrays, row: int, step: int) -> Difference | None:
    """First difference of a stepper's current state from the recorded result of a step; None if all fields are identical bit for bit."""
    n = sim.num_envs or 1
    for name in COMPARED:
        was, now = arrays[name], np.asarray(getattr(sim, name))
        if was.shape != now.shape:
            raise ValueError(f"{name} has shape {was.shape}, must be {now.shape}")
        was, now = was.reshape(n, -1), now.reshape(n, -1)
        # Compare bytes: -0 differs from 0, and NaN equals NaN.
        differs = was.dtype != now.dtype or was.tobytes() != now.tobytes()
        if differs:
            env = next((e for e in range(n) if was[e].tobytes() != now[e].tobytes()), 0)
            return Difference(row, step, name, env, was[env], now[env])
    return None
