"""Format of a recording, and functions to read it. Files that were truncated, swapped or edited are detected by their SHA-256.

A recording is a folder:

    run.json         versions, machine, options, precision, seed, digest of the model, units of the fields;
                     for every .npz file the numbers of rows and of calls of step, and the SHA-256;
                     failures; whether the recording was closed; and the SHA-256 of run.json itself
    model.stepper    the model, as written by `Model.save`
    00000.npz ...    rows; a row is an event such as a call of step or reset

run.json is replaced atomically after every .npz file, so that a crash loses only the last file.

The array `kind`, (n,), of a .npz file has the kind of each row as an index into `KINDS`. Fields of the rows of steps (`FIELDS`) are stacked
in one array per field. Arguments of other rows are stored in arrays with the name "row/argument".
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from stepper.shared.files import atomic_write, existing

Arrays = dict[str, np.ndarray[Any, Any]]
Header = dict[str, Any]

FORMAT = 6
"""Version of the format of recordings. Since version 6, fields have the names of attributes and arguments of `Stepper`."""
HEADER, MODEL = "run.json", "model.stepper"
KINDS = ("start", "step", "reset", "set_state", "applied", "randomize")
"""Kinds of recorded events (rows of a recording).

An event "applied" has the applied forces, mocap poses and active equalities of the next step. The event is recorded
only if these have changed.
"""
FIELDS = {
    "ctrl": "in the unit of the actuator, as given",
    "nstep": "number of steps of the call",
    "qpos": "m and rad",
    "qvel": "m/s and rad/s",
    "act": "",
    "time": "s",
    "sensordata": "in the unit of the sensor",
    "residual": "m/s",
    "iterations": "",
    "status": "flags, stepper.Status",
    "max_penetration": "m",
    "max_limit_violation": "rad or m",
    "max_equality_violation": "m or rad",
}
COMPARED = tuple(name for name in FIELDS if name not in ("ctrl", "nstep"))
"""Fields that a replay compares bit for bit."""


class RecordingError(ValueError):
    """A recording cannot be read or replayed. The message has the file or row, the problem and a remedy."""


@contextmanager
def reading(place: str | Path) -> Iterator[None]:
    """Context manager that converts exceptions from invalid contents into a `RecordingError` whose message begins with `place`.

    OSError and MemoryError are not converted.
    """
    try:
        yield
    except (RecordingError, OSError, MemoryError):
        raise
    except Exception as error:
        problem = f"{error.args[0]} is missing" if isinstance(error, KeyError) and error.args else str(error) or type(error).__name__
        raise RecordingError(f"{place}: {problem}; copy the recording again, or record it again") from error


def digest_of(file: BinaryIO) -> str:
    """SHA-256 of a file from its current position on, in hexadecimal."""
    return hashlib.file_digest(cast("BufferedReader", file), "sha256").hexdigest()


def write_header(folder: Path, head: Header) -> None:
    """Writes the file run.json of a recording with its SHA-256, atomically."""
    text = json.dumps(head | {"sha256": _digest_of_header(head)}, indent=2) + "\n"
    with atomic_write(folder / HEADER) as file:
        file.write(text.encode())


def _digest_of_header(head: Header) -> str:
    """SHA-256 of the contents of run.json without the entry "sha256", in hexadecimal."""
    held = {name: value for name, value in head.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


def read_header(folder: Path) -> Header:
    """Reads and checks the file run.json of a recording.

    Raises:
        RecordingError: The format has another version, or the file was changed.
        OSError: The file cannot be read.
    """
    file = existing(folder / HEADER, "recording")
    with reading(file):
        head = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(head, dict):
            raise RecordingError(f"{file}: the contents are not those of a recording; give a folder that Stepper.record wrote")
        if head.get("format") != FORMAT:
            made = head.get("provenance", {}).get("versions", {}).get("stepper", "an unknown version")
            raise RecordingError(
                f"{folder} has format {head.get('format')} of recordings, this version reads format {FORMAT}: replay it with stepper {made}"
            )
        if head["sha256"] != _digest_of_header(head):
            raise RecordingError(f"{file}: its contents do not match its SHA-256: it was damaged or edited; copy the recording again")
        if not isinstance(head["closed"], bool):
            raise RecordingError(f"{file}: closed is {head['closed']!r}, must be true or false")
        name = head["model"]["file"]
        if name != MODEL:
            raise RecordingError(f"{file}: model.file is {name!r}, must be {MODEL!r}, in the folder of the recording")
    return head


def check_files(folder: Path, head: Header) -> None:
    """Checks that the files of a recording are those that run.json lists.

    Raises:
        RecordingError: A file is missing, or there is an additional one.
    """
    with reading(folder / HEADER):
        listed = [entry["name"] for entry in head["files"]]
        rows = sum(entry["rows"] for entry in head["files"])
        if listed != [f"{k:05d}.npz" for k in range(len(listed))] or rows != head["rows"]:
            raise RecordingError(f"{folder / HEADER}: {len(listed)} files with {rows} rows are listed, but {head['rows']} rows in total")
        there = {file.name for file in folder.glob("*.npz")}
        if missing := [name for name in listed if name not in there]:
            raise RecordingError(f"{folder}: {missing[0]} is missing, {len(missing)} of {len(listed)} files; copy the recording again")
        # A recording that was not closed may have a file that run.json does not list yet.
        if head["closed"] and (more := sorted(there.difference(listed))):
            raise RecordingError(f"{folder}: {more[0]} does not belong to this recording; remove it, or copy the recording again")


def read_rows(folder: Path, head: Header) -> Iterator[tuple[str, str, Arrays]]:
    """Yields the recorded events (rows) of a recording. Only one file is in memory at a time.

    Each row is a tuple of a text with its file and index (for error messages), its kind, and its arrays by name.

    Raises:
        RecordingError: A file is missing, additional or changed.
        OSError: A file cannot be read.
    """
    check_files(folder, head)
    for entry in head["files"]:
        path = folder / entry["name"]
        with reading(path):
            kinds, arrays = _read_file(path, entry)
        step = 0
        for row, kind in enumerate(kinds):
            place = f"{path}, row {row}"
            if kind == "step":
                with reading(place):
                    own = {name: values[step] for name, values in arrays.items() if "/" not in name}
                step += 1
            else:
                own = {name.removeprefix(f"{row}/"): values for name, values in arrays.items() if name.startswith(f"{row}/")}
            yield place, kind, own


def _read_file(path: Path, entry: dict[str, Any]) -> tuple[list[str], Arrays]:
    """Reads a .npz file of a recording and checks it against its entry in run.json.

    Returns:
        Kind of each recorded event (row), and the arrays by name.
    """
    with path.open("rb") as file:
        if digest_of(file) != entry["sha256"]:
            raise RecordingError(
                f"{path}: its contents are not those that were recorded: the file was truncated, swapped or edited; copy it again"
            )
        file.seek(0)
        with np.load(file, allow_pickle=False) as chunk:
            arrays = dict(chunk)
    kinds = [KINDS[k] for k in arrays.pop("kind")]
    if (len(kinds), kinds.count("step")) != (entry["rows"], entry["steps"]):
        raise RecordingError(f"{path}: {len(kinds)} rows, {kinds.count('step')} of step, must be {entry['rows']} and {entry['steps']}")
    return kinds, arrays
