"""A recording made again, compared bit for bit."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepper._actuators import ActuatorModel
from stepper._options import Options
from stepper._record import APPLIED, COMPARED, FORMAT, KINDS
from stepper._sensors import SensorModel
from stepper._stepper import Model, State, Stepper, __version__

Arrays = dict[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class Difference:
    """The first number that a replay did not reproduce.

    Attributes:
        row: Row of the recording.
        step: Call of `step`, counted from 0.
        field: What differs.
        env: Environment; 0 for a single one.
        recorded: What was recorded for that environment.
        replayed: What came out now.
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
class Replay:
    """How a replay went.

    Attributes:
        rows: Rows that were repeated.
        steps: Calls of `step` among them.
        difference: The first difference; None when every bit was reproduced.
        complete: Whether the recording was closed; else its last rows may be missing.
        versions: Version of stepper that recorded, and this one; bits are promised for equal versions only.
    """

    rows: int
    steps: int
    difference: Difference | None
    complete: bool
    versions: tuple[str, str]

    def __bool__(self) -> bool:
        """Whether every bit was reproduced."""
        return self.difference is None

    def __str__(self) -> str:
        end = "" if self.complete else "; the recording was not closed, its end may be missing"
        recorded, here = self.versions
        if recorded != here:
            end += f"; recorded by stepper {recorded}, replayed by {here}"
        if self.difference is None:
            return f"{self.steps} calls of step in {self.rows} rows reproduced, bit for bit{end}"
        return f"differs at {self.difference}{end}"


def replay(path: str | os.PathLike[str], *, model: Model | None = None, threads: int | None = None) -> Replay:
    """Repeats a recording and compares states, observations, residuals and flags, bit for bit. It stops at the first difference.

    Args:
        path: The folder that `Stepper.record` wrote.
        model: The model that it must belong to; None takes the recording's own.
        threads: Threads that step; None is as recorded. The bits do not depend on it.

    Raises:
        ValueError: The recording is of another model, or damaged.
        OSError: It cannot be read.
    """
    folder = Path(path)
    head = read_header(folder)
    own = Model.from_file(folder / head["model"]["file"])
    for digest, whose in [(own.digest, "the model in its folder"), (model.digest if model else own.digest, "the model given")]:
        if digest != head["model"]["sha256"]:
            name = head["model"]["name"]
            raise ValueError(f'{folder} was recorded with model "{name}" {head["model"]["sha256"][:12]}, {whose} is {digest[:12]}')
    sim = Stepper(
        own,
        head["num_envs"],
        options=Options(**head["options"]),
        precision=head["precision"],
        threads=head["threads"] if threads is None else threads,
        seed=head["seed"],
        actuators=None if head.get("actuators") is None else ActuatorModel.from_dict(head["actuators"], str(folder)),
        sensors=None if head.get("sensors") is None else SensorModel.from_dict(head["sensors"], str(folder)),
    )
    versions = (head["provenance"]["versions"]["stepper"], __version__)
    rows = steps = 0
    for kind, arrays in read_rows(folder):
        difference = _repeat(sim, kind, arrays, rows, steps)
        rows, steps = rows + 1, steps + (kind == "step")
        if difference:
            return Replay(rows, steps, difference, head["closed"], versions)
    return Replay(rows, steps, None, head["closed"], versions)


def read_header(folder: Path) -> dict[str, Any]:
    """The contents of run.json.

    Raises:
        ValueError: It is not one that this version reads.
    """
    head: dict[str, Any] = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    if head.get("format") != FORMAT:
        raise ValueError(f"{folder} has format {head.get('format')} of recordings, this version reads {FORMAT}")
    return head


def read_rows(folder: Path) -> Iterator[tuple[str, Arrays]]:
    """Every row of a recording: what it was, and its arrays. One file is in memory at a time."""
    for file in sorted(folder.glob("[0-9]*.npz")):
        with np.load(file, allow_pickle=False) as chunk:
            arrays = dict(chunk)
        step = 0
        for row, kind in enumerate(KINDS[k] for k in arrays.pop("kind")):
            if kind == "step":
                yield kind, {name: values[step] for name, values in arrays.items() if "/" not in name}
                step += 1
            else:
                own = f"{row}/"
                yield kind, {name.removeprefix(own): values for name, values in arrays.items() if name.startswith(own)}


def _repeat(sim: Stepper, kind: str, arrays: Arrays, row: int, step: int) -> Difference | None:
    if kind == "step":
        ctrl = arrays["ctrl"] if sim.num_envs is not None else arrays["ctrl"][0]
        sim.step(ctrl, nstep=int(arrays["nstep"]))
        return _compare(sim, arrays, row, step)
    if kind in ("start", "set_state") and "state" in arrays:
        _randomize(sim, arrays)
        sim.set_state(State(arrays["state"].tobytes(), bytes.fromhex(sim.model.digest)))
    elif kind == "set_state":
        sim.set_state(**arrays)
    elif kind == "randomize":
        _randomize(sim, arrays)
    elif kind == "reset":
        word, number = arrays.pop("keyframe", None), arrays.pop("seed", None)
        keyframe, seed = None if word is None else str(word), None if number is None else int(number)
        sim.reset(**arrays, keyframe=keyframe, seed=seed)
    else:
        for name in APPLIED:
            if name in arrays:
                setattr(sim, name, arrays[name])
    return None


def _randomize(sim: Stepper, arrays: Arrays) -> None:
    """Assigns the fields of a row of the recording; its rows are those of the environments that changed."""
    rows = {name.removeprefix("theta/"): values for name, values in arrays.items() if name.startswith("theta/")}
    n = sim.num_envs or 1
    mask = arrays.get("mask", np.full(n, True))
    fields: dict[str, np.ndarray[Any, Any] | ActuatorModel | None] = {str(name): None for name in arrays.get("shared", ())}
    for name, values in rows.items():
        shape = np.shape(getattr(sim.model, name))
        full = np.zeros((n, *shape))
        full[mask] = values.reshape(-1, *shape)
        fields[name] = full if sim.num_envs is not None else full[0]
    if "actuators" in arrays:
        fields["actuators"] = ActuatorModel.from_dict(json.loads(str(arrays["actuators"]))).spread(mask)
    if fields or "mask" in arrays:
        sim.randomize(mask, **fields)


def _compare(sim: Stepper, arrays: Arrays, row: int, step: int) -> Difference | None:
    n = sim.num_envs or 1
    for name in COMPARED:
        was, now = arrays[name].reshape(n, -1), np.asarray(getattr(sim, name)).reshape(n, -1)
        # As bits, so that -0 is not 0 and NaN is NaN.
        differs = was.dtype != now.dtype or was.tobytes() != now.tobytes()
        if differs:
            env = next((e for e in range(n) if was[e].tobytes() != now[e].tobytes()), 0)
            return Difference(row, step, name, env, was[env], now[env])
    return None
