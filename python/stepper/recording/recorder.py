"""`Recorder`: writes inputs and results of each call of a stepper to disk, in the format of `stepper.recording.format`.

Recorded events wait in memory for at most `INTERVAL`, and are then appended to the file of rows. A process that is killed loses no more.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time
import weakref
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._stepper import Stepper, selected
from stepper.loading import origin_of
from stepper.recording.format import COMPARED, FIELDS, FIRST_DIGEST, FORMAT, KINDS, MODEL, ROWS, append_block, archive_of, write_header
from stepper.shared.arguments import check_kind, check_whole, path_of
from stepper.shared.fields import APPLIED
from stepper.shared.files import LOCK, lock_of, os_errors_of
from stepper.shared.machine import provenance

if TYPE_CHECKING:
    from stepper._stepper import Model

INTERVAL = 1.0
"""Age of the oldest recorded event in memory at which the events are written, s."""


class Recorder:
    """Writer of the calls and results of a `Stepper` to a folder; a context manager. `close` completes the recording.

    `sim.record(path)` is the same as `stepper.Recorder(sim, path)`. Recorded events are written every second. A recording whose process is
    killed, or whose disk is full, ends at most a second before, and can be replayed up to its end. After an error of writing, the stepper
    runs without recording.

    Args:
        sim: The stepper, without another recorder.
        path: New or empty folder.
        chunk: Size of the recorded events in memory at which they are written before a second has passed, bytes.
        note: Remark of the user, which is stored in the file run.json.

    Raises:
        BlockingIOError: Another run writes to the folder.
        FileExistsError: The folder is not empty, or a file has this path.
        ValueError: The stepper already has a recorder.
        OSError: A file cannot be written. `close` and the recorded calls of the stepper raise it too.
    """

    def __init__(self, sim: Stepper, path: str | os.PathLike[str], *, chunk: int = 64 << 20, note: str = ""):
        check_kind("sim", sim, Stepper, "sim.record(path) of a stepper is shorter")
        if sim.recorder is not None:
            raise ValueError(f"this stepper is already being recorded to {sim.recorder.path}; close that recording first")
        check_whole("chunk (bytes)", chunk, least=1)
        self._path = path_of("path", path)
        self._unlock = weakref.finalize(self, _locked_folder(self._path).close)
        self._sim, self._chunk = sim, chunk
        self._rows = self._stored_rows = self._stored_steps = self._size = 0
        self._digest = FIRST_DIGEST
        self._applied: list[np.ndarray[Any, Any] | None] = [None] * len(APPLIED)
        self._clear()
        sim.model.save(self._path / MODEL)
        self._header = header(sim, note)
        self._add("start", state=_state_bytes(sim), **_parameters(sim.randomized, np.full(sim.num_envs or 1, True)))
        self._flush()
        sim.recorder = self

    @property
    def path(self) -> Path:
        """Folder of the recording."""
        return self._path

    @property
    def rows(self) -> int:
        """Number of events recorded so far: the start, calls, and changes of applied forces."""
        return self._rows

    def step(self, sim: Stepper, *, ctrl: np.ndarray[Any, Any], nstep: int, applied: list[np.ndarray[Any, Any] | None]) -> None:
        """Records a call of `Stepper.step` with controls (num_envs, nu). The stepper calls this method after the steps.

        `applied` contains applied forces, mocap poses and active equalities, in the order of the names in `APPLIED`. Arrays that the
        user never set are None.
        """
        if not all(_same(now, before) for now, before in zip(applied, self._applied, strict=True)):
            self._applied = [None if now is None else now.copy() for now in applied]
            self._add("applied", **{name: now for name, now in zip(APPLIED, self._applied, strict=True) if now is not None})
        row = {name: np.asarray(getattr(sim, name)) for name in COMPARED}
        row |= {"ctrl": ctrl, "nstep": np.asarray(nstep)}
        for name, value in row.items():
            self._steps[name].append(value)
        self._count("step", sum(value.nbytes for value in row.values()))

    def reset(self, _sim: Stepper, **arguments: Any) -> None:
        """Records a call of `Stepper.reset` with its arguments.

        A reset clears applied forces. The next call of `step` therefore records the applied forces again, even if they are as before.
        """
        self._applied = [None] * len(APPLIED)
        self._add("reset", **arguments)

    def set_state(self, _sim: Stepper, **arguments: Any) -> None:
        """Records a call of `Stepper.set_state` with its arguments."""
        if "state" in arguments:
            arguments = {"state": _state_bytes(self._sim)}
        self._add("set_state", **arguments)

    def randomize(self, sim: Stepper, *, envs: Any = None, fields: dict[str, Any] | None = None) -> None:
        """Records a call of `Stepper.randomize`, with the values of the changed environments only.

        Args:
            sim: The stepper.
            envs: Argument of `randomize`: mask or indices of the environments; None selects all environments.
            fields: Arrays of parameters by name of the field, as given to `randomize`. A None in place of an array restores the value of
                the model.
        """
        chosen, order = np.zeros(sim.num_envs or 1, dtype=bool), selected(envs, sim.num_envs or 1)
        chosen[order] = True
        rows = {name: values for name, values in (fields or {}).items() if values is not None}
        if envs is not None and np.asarray(envs).dtype != np.bool_:  # The arrays have one row per index.
            rows = {name: values if name == "actuators" else _of_all(values, order, len(chosen)) for name, values in rows.items()}
        # Fields that are set back to the values of the model.
        shared = [name for name in fields or {} if name not in rows]
        self._add("randomize", envs=chosen, shared=np.array(shared, "U"), **_parameters(rows, chosen))

    def close(self) -> None:
        """Writes the events that are still in memory, and marks the recording as complete. The stepper then runs without recording."""
        if self._sim.recorder is self:
            self._flush(closed=True)
            self._end()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _add(self, kind: str, **arguments: Any) -> None:
        """Adds a recorded event other than a call of `step`: its kind (one of `KINDS`), and copies of its arguments as arrays."""
        # Copy, because the caller may change the arrays later.
        arrays = {name: np.array(value) for name, value in arguments.items()}
        self._others |= {f"{len(self._kinds)}/{name}": value for name, value in arrays.items()}
        self._count(kind, sum(value.nbytes for value in arrays.values()))

    def _count(self, kind: str, nbytes: int) -> None:
        """Counts a new recorded event of `nbytes` bytes, and writes the events in memory if they are too large or too old."""
        self._kinds.append(KINDS.index(kind))
        self._rows += 1
        self._bytes += nbytes
        if self._bytes >= self._chunk or time.monotonic() - self._written >= INTERVAL:
            self._flush()

    def _clear(self) -> None:
        """Removes the recorded events from memory."""
        self._kinds: list[int] = []
        self._steps: dict[str, list[np.ndarray[Any, Any]]] = {name: [] for name in FIELDS}
        self._others: dict[str, np.ndarray[Any, Any]] = {}
        self._bytes = 0
        self._written = time.monotonic()

    def _flush(self, *, closed: bool = False) -> None:
        """Appends the recorded events in memory (if there are any) to the file of rows, and updates the file run.json.

        After an error, the recording ends with the rows that were written before.
        """
        try:
            if self._kinds:
                self._write_rows()
            entries = {"closed": closed, "rows": self._stored_rows, "steps": self._stored_steps, "size": self._size}
            write_header(self._path, self._header | entries | {"digest": self._digest.hex()})
        except OSError as error:
            self._end()
            error.strerror = f"{error.strerror}; the recording ends here, after {self._stored_rows} rows"
            raise

    def _write_rows(self) -> None:
        """Appends the recorded events in memory to the file of rows as a block, and removes them from memory."""
        stacked = {name: np.stack(rows) for name, rows in self._steps.items() if rows}
        archive = archive_of({"kind": np.array(self._kinds, np.uint8), **stacked, **self._others})
        rows, steps = len(self._kinds), self._kinds.count(KINDS.index("step"))
        path = self._path / ROWS
        # The file is opened for each block, so that a recorder that is never closed keeps no file open.
        with os_errors_of(path), path.open("ab", buffering=0) as file:
            try:
                self._digest = append_block(file, archive, rows, steps, self._digest)
            except BaseException:
                file.truncate(self._size)
                raise
            self._size = file.tell()
        self._stored_rows, self._stored_steps = self._stored_rows + rows, self._stored_steps + steps
        self._clear()

    def _end(self) -> None:
        """Ends the recording: the stepper runs without recording, and the folder is unlocked."""
        if self._sim.recorder is self:
            self._sim.recorder = None
        self._unlock()
        # No other recorder can begin in this folder, because it is not empty, so that its lock is no longer needed.
        (self._path / LOCK).unlink(missing_ok=True)


def _locked_folder(path: Path) -> Any:
    """Lock of the folder of a new recording; see `stepper.shared.files.lock_of`. The folder must be new or empty."""
    if path.is_file():
        raise FileExistsError(f"{path} is a file, but a recording is a folder; give the path of a new folder")
    # A folder of other files gets no lock.
    if _has_files(path) and not (path / LOCK).exists():
        raise FileExistsError(f"{path} is not empty; give a new folder, or remove it")
    lock = lock_of(path)
    if _has_files(path):
        lock.close()
        raise FileExistsError(f"{path} is not empty; give a new folder, or remove it")
    return lock


def _has_files(folder: Path) -> bool:
    """Whether a folder exists and has other files than a lock."""
    return folder.exists() and any(file.name != LOCK for file in folder.iterdir())


def header(sim: Stepper, note: str = "") -> dict[str, Any]:
    """Entries of run.json that do not change during the recording: versions, machine, options, precision, seed and model."""
    return {
        "format": FORMAT,
        "note": note,
        "model": {"name": sim.model.name, "sha256": sim.model.digest, "file": MODEL, **_source(sim.model)},
        "options": dataclasses.asdict(sim.options),
        "timestep": sim.timestep,
        "tolerance": sim.tolerance,
        "num_envs": sim.num_envs,
        "precision": sim.precision,
        "threads": sim.threads,
        "seed": sim.seed,
        "actuators": None if sim.actuators is None else sim.actuators.to_dict(),
        "sensors": None if sim.sensors is None else sim.sensors.to_dict(),
        "fields": FIELDS,
        "provenance": provenance(),
    }


def _source(model: Model) -> dict[str, Any]:
    """File from which a model was loaded, with its added floor and free base, for drawing colours and meshes; None if it is unknown."""
    origin = origin_of(model)
    if origin is None or not origin.is_file:
        return {"source": None}
    return {"source": str(origin.source), "floor": origin.floor, "free_base": origin.free_base}


def _parameters(fields: dict[str, Any], chosen: np.ndarray[Any, Any]) -> dict[str, np.ndarray[Any, Any]]:
    """Arrays that a recording stores for the per-environment parameters of some environments, a mask (num_envs,), by name.

    "actuators" is an `ActuatorModel`, which is stored as JSON.
    """
    rows = {name: values for name, values in fields.items() if name != "actuators"}
    kept = {f"randomized/{name}": np.asarray(values, np.float64).reshape(len(chosen), -1)[chosen] for name, values in rows.items()}
    if "actuators" in fields:
        kept["actuators"] = np.array(json.dumps(fields["actuators"].chosen(chosen).to_dict()))
    return kept


def _of_all(values: Any, order: list[int], num_envs: int) -> np.ndarray[Any, Any]:
    """Array for all environments, (num_envs, ...), with `values` at the indices `order` of environments, and 0 elsewhere."""
    full = np.zeros((num_envs, *np.shape(values)[1:]))
    full[order] = values
    return full


def _state_bytes(sim: Stepper) -> np.ndarray[Any, Any]:
    """Full state of a stepper as an array of bytes."""
    return np.frombuffer(sim.get_state().bytes, np.uint8)


def _same(a: np.ndarray[Any, Any] | None, b: np.ndarray[Any, Any] | None) -> bool:
    """Whether two arrays are equal bit for bit, or both None."""
    return (a is None and b is None) or (a is not None and b is not None and a.tobytes() == b.tobytes())
