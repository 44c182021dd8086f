"""Format of a recording, and functions to read it. Files that were cut, swapped or edited raise an error with the place.

A recording is a folder:

    run.json         versions, machine, options, precision, seed, digest of the model, shapes and units of the fields;
                     of every file its rows, its calls of step and its SHA-256; what failed; whether it was closed; and its own SHA-256
    model.stepper    the model, as `Model.save` writes it
    00000.npz ...    rows, each file complete in itself

run.json is replaced atomically after every file: a crash loses only the last file.

Arrays of a file: `kind` (n,) gives the kind of each row (`KINDS`). The rows of steps have the fields of `FIELDS`, stacked in
their order; the others their arguments, as "row/name".
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
"""6: names are those of the attributes and arguments of `Stepper`."""
HEADER, MODEL = "run.json", "model.stepper"
KINDS = ("start", "step", "reset", "set_state", "applied", "randomize")
"""Kinds of rows. "applied" stands before a step whose forces, mocap poses or equalities are other than those of the step before."""
FIELDS = {
    "ctrl": "as given, N, N m or what the actuator takes",
    "nstep": "steps of the call",
    "qpos": "m and rad",
    "qvel": "m/s and rad/s",
    "act": "",
    "time": "s",
    "sensordata": "of each sensor",
    "residual": "m/s",
    "iterations": "",
    "status": "flags, stepper.Status",
    "max_penetration": "m",
    "max_limit_violation": "rad or m",
    "max_equality_violation": "m or rad",
}
COMPARED = tuple(name for name in FIELDS if name not in ("ctrl", "nstep"))
"""Fields that a replay has to reproduce, bit for bit."""


class RecordingError(ValueError):
    """Recording that cannot be read or repeated; the message has the place, the problem and the remedy."""


@contextmanager
def reading(place: str | Path) -> Iterator[None]:
    """Context that turns errors in the contents of a file into a `RecordingError` with the place.

    OSError and MemoryError stay as they are.
    """
    try:
        yield
    except (RecordingError, OSError, MemoryError):
        raise
    except Exception as error:
        what = f"{error.args[0]} is missing" if isinstance(error, KeyError) and error.args else str(error) or type(error).__name__
        raise RecordingError(f"{place}: {what}; copy the recording again, or record it again") from error


def digest_of(file: BinaryIO) -> str:
    """SHA-256 of a file from its present place on, in hexadecimal."""
    return hashlib.file_digest(cast("BufferedReader", file), "sha256").hexdigest()


def write_header(folder: Path, head: Header) -> None:
    """Writes run.json with its checksum, in one piece."""
    text = json.dumps(head | {"sha256": _digest_of_header(head)}, indent=2) + "\n"
    with atomic_write(folder / HEADER) as file:
        file.write(text.encode())


def _digest_of_header(head: Header) -> str:
    held = {name: value for name, value in head.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


def read_header(folder: Path) -> Header:
    """Contents of run.json.

    Raises:
        RecordingError: The format is of another version, or the file was changed.
        OSError: It cannot be read.
    """
    file = existing(folder / HEADER, "recording")
    with reading(file):
        head = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(head, dict):
            raise RecordingError(f"{file}: no description of a recording; give the folder that Stepper.record wrote")
        if head.get("format") != FORMAT:
            made = head.get("provenance", {}).get("versions", {}).get("stepper", "an unknown version")
            raise RecordingError(
                f"{folder} has format {head.get('format')} of recordings, this version reads {FORMAT}: replay it with stepper {made}"
            )
        if head["sha256"] != _digest_of_header(head):
            raise RecordingError(f"{file}: its contents do not match its SHA-256: it was damaged or edited; copy the recording again")
        if not isinstance(head["closed"], bool):
            raise RecordingError(f"{file}: closed is {head['closed']!r}, must be true or false")
        name = head["model"]["file"]
        if name != MODEL:
            raise RecordingError(f"{file}: model.file is {name!r}, must be {MODEL!r}, which lies in the recording's own folder")
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
            raise RecordingError(f"{folder / HEADER}: {len(listed)} files of {rows} rows together are not its {head['rows']} rows")
        there = {file.name for file in folder.glob("*.npz")}
        if missing := [name for name in listed if name not in there]:
            raise RecordingError(f"{folder}: {missing[0]} is missing, {len(missing)} of {len(listed)} files; copy the recording again")
        # A run that was cut off can have written a file that run.json does not have yet.
        if head["closed"] and (more := sorted(there.difference(listed))):
            raise RecordingError(f"{folder}: {more[0]} is no file of this recording; remove it, or copy the recording again")


def read_rows(folder: Path, head: Header) -> Iterator[tuple[str, str, Arrays]]:
    """Rows of a recording, each with its place, kind and arrays. One file is in memory at a time.

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
    with path.open("rb") as file:
        if digest_of(file) != entry["sha256"]:
            raise RecordingError(f"{path}: its contents are not those that were recorded: it was cut, swapped or edited; copy it again")
        file.seek(0)
        with np.load(file, allow_pickle=False) as chunk:
            arrays = dict(chunk)
    kinds = [KINDS[k] for k in arrays.pop("kind")]
    if (len(kinds), kinds.count("step")) != (entry["rows"], entry["steps"]):
        raise RecordingError(f"{path}: {len(kinds)} rows, {kinds.count('step')} of step, must be {entry['rows']} and {entry['steps']}")
    return kinds, arrays
