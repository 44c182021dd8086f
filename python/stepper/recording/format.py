"""Format of a recording, and functions to read and write it. Files that were truncated, swapped or edited are detected by their SHA-256.

A recording is a folder:

    run.json         versions, machine, options, precision, seed, digest of the model, units of the fields;
                     numbers of rows and of calls of step, size and digest of rows.bin;
                     whether the recording was closed; and the SHA-256 of run.json itself
    model.stepper    the model, as written by `Model.save`
    rows.bin         blocks of rows; a row is an event such as a call of step or reset

Each block of rows.bin is an .npz archive of NumPy after a header (`_BLOCK`). The header has the length of the archive in bytes, the numbers
of rows and of calls of step, and the digest of the block. The digest is the SHA-256 of the digest of the block before (zeros for the first
one), both numbers and the archive.

Blocks are appended while the simulation runs, and run.json is replaced atomically after each of them. If the process is stopped, or the
disk is full, all blocks but an unfinished last one remain.

The array `kind`, (n,), of a block has the kind of each row as an index into `KINDS`. Fields of the rows of steps (`FIELDS`) are stacked in
one array per field. Arguments of other rows are stored in arrays with the name "row/argument".

format.json has the version, the names of the files and the kinds. The Rust program `anatomy` (benches/src/replay.rs) reads it too.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import struct
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from stepper.shared.files import existing, explained, read_arrays, write_text

Arrays = dict[str, np.ndarray[Any, Any]]
Header = dict[str, Any]

_SHARED = json.loads(Path(__file__).with_name("format.json").read_text(encoding="utf-8"))
FORMAT: int = _SHARED["format"]
"""Version of the format of recordings. Version 6 gave fields the names of attributes of `Stepper`, version 7 has all rows in one file,
version 8 another digest of the model."""
HEADER: str = _SHARED["header"]
MODEL: str = _SHARED["model"]
ROWS: str = _SHARED["rows"]
KINDS: tuple[str, ...] = tuple(_SHARED["kinds"])
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


_BLOCK = struct.Struct("<QQQ32s")
"""Header of a block of rows.bin: length of the archive in bytes, number of rows, number of calls of step, digest."""
FIRST_DIGEST = bytes(32)
"""Digest before the first block."""
_COPY = "copy the recording again, or record it again"


class RecordingError(ValueError):
    """Error of a recording that cannot be read or replayed. The message has the file or row, the problem and a remedy."""


class RecordingWarning(UserWarning):
    """Warning that a recording was not closed: its process was stopped or is still running, or its disk was full."""


@contextmanager
def reading(place: str | Path) -> Iterator[None]:
    """Context manager that converts exceptions from invalid contents into a `RecordingError` whose message names `place`.

    OSError and MemoryError are not converted.
    """
    with explained(place, _COPY, RecordingError, passing=(RecordingError,)):
        yield


@dataclass(frozen=True)
class Block:
    """Position and header of a block of rows.bin.

    Attributes:
        start: Offset of the archive in the file, bytes.
        length: Length of the archive, bytes.
        rows: Number of rows.
        steps: Number of calls of step among the rows.
        digest: Digest of the block.
    """

    start: int
    length: int
    rows: int
    steps: int
    digest: bytes

    @property
    def end(self) -> int:
        """Offset of the end of the block in the file, bytes."""
        return self.start + self.length


def archive_of(arrays: Mapping[str, Any]) -> bytes:
    """Bytes of an .npz archive with arrays by name."""
    data = io.BytesIO()
    np.savez(data, **arrays)
    return data.getvalue()


def append_block(file: BinaryIO, archive: bytes, rows: int, steps: int, previous: bytes) -> bytes:
    """Writes a block to a file at its current position.

    Args:
        file: The file, which may write a part of the data only.
        archive: Archive of the rows.
        rows: Number of rows in the archive.
        steps: Number of calls of step among them.
        previous: Digest of the block before.

    Returns:
        Digest of the block.
    """
    digest = _digest_of(previous, rows, steps, archive)
    for part in (_BLOCK.pack(len(archive), rows, steps, digest), archive):
        left = memoryview(part)
        while left:
            left = left[file.write(left) :]
    return digest


def _digest_of(previous: bytes, rows: int, steps: int, archive: bytes) -> bytes:
    """Digest of a block, from the digest of the block before, its numbers of rows and of calls of step, and its archive."""
    return hashlib.sha256(previous + struct.pack("<QQ", rows, steps) + archive).digest()


def write_header(folder: Path, head: Header) -> None:
    """Writes the file run.json of a recording with its SHA-256, atomically."""
    write_text(folder / HEADER, json.dumps(head | {"sha256": _digest_of_header(head)}, indent=2) + "\n")


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
            found = f"it has format {head.get('format')} of recordings, this version reads format {FORMAT}"
            raise RecordingError(f"{file}: {found}: replay it with stepper {made}")
        if head["sha256"] != _digest_of_header(head):
            raise RecordingError(f"{file}: its contents do not match its SHA-256: it was damaged or edited; copy the recording again")
        if not isinstance(head["closed"], bool):
            raise RecordingError(f"{file}: closed is {head['closed']!r}, must be true or false")
        for name in ("rows", "steps", "size"):
            if type(head[name]) is not int or head[name] < 0:
                raise RecordingError(f"{file}: {name} is {head[name]!r}, must be a whole number of at least 0")
        name = head["model"]["file"]
        if name != MODEL:
            raise RecordingError(f"{file}: model.file is {name!r}, must be {MODEL!r}, in the folder of the recording")
    return head


def find_blocks(folder: Path, head: Header) -> list[Block]:
    """Finds the blocks of a recording, and compares them with run.json. Reads the headers of the blocks, and not their rows.

    A recording that was not closed may have more blocks than run.json counts, and an unfinished last block, which is left out.

    Raises:
        RecordingError: Rows are missing, or there are additional ones.
        OSError: The file cannot be read.
    """
    path = folder / ROWS
    blocks: list[Block] = []
    with reading(path), existing(path, "rows").open("rb") as file:
        size, start = os.fstat(file.fileno()).st_size, 0
        if size < head["size"] or (head["closed"] and size != head["size"]):
            raise RecordingError(f"{path}: it has {size} bytes, {HEADER} counts {head['size']}: it was truncated or replaced; {_COPY}")
        while size - start >= _BLOCK.size:
            file.seek(start)
            length, rows, steps, digest = _BLOCK.unpack(file.read(_BLOCK.size))
            if length > size - start - _BLOCK.size:
                break
            blocks.append(Block(start + _BLOCK.size, length, rows, steps, digest))
            start = blocks[-1].end
        counted = [block for block in blocks if block.end <= head["size"]]
        found = (sum(block.rows for block in counted), sum(block.steps for block in counted), counted[-1].end if counted else 0)
        digest = counted[-1].digest if counted else FIRST_DIGEST
        if (*found, digest.hex()) != (head["rows"], head["steps"], head["size"], head["digest"]):
            raise RecordingError(f"{path}: its {found[0]} rows are not the {head['rows']} that {HEADER} counts; {_COPY}")
    return blocks


def read_rows(folder: Path, head: Header) -> Iterator[tuple[str, str, Arrays]]:
    """Yields the recorded events (rows) of a recording. Only one block is in memory at a time.

    Each row is a tuple of a text with its file and index (for error messages), its kind, and its arrays by name.

    Raises:
        RecordingError: Rows are missing, additional or changed.
        OSError: A file cannot be read.
    """
    path, row, previous = folder / ROWS, 0, FIRST_DIGEST
    for block in find_blocks(folder, head):
        with path.open("rb") as file:
            file.seek(block.start)
            archive = file.read(block.length)
        if _digest_of(previous, block.rows, block.steps, archive) != block.digest:
            if block.start >= head["size"]:  # The process was stopped before this block was on the disk.
                return
            raise RecordingError(f"{path}, row {row}: the rows are not those that were recorded: the file was damaged or edited; {_COPY}")
        previous = block.digest
        with reading(f"{path}, row {row}"):
            kinds, arrays = _read_block(f"{path}, row {row}", archive, block)
        step = 0
        for index, kind in enumerate(kinds):
            place = f"{path}, row {row}"
            if kind == "step":
                with reading(place):
                    own = {name: values[step] for name, values in arrays.items() if "/" not in name}
                step += 1
            else:
                own = {name.removeprefix(f"{index}/"): values for name, values in arrays.items() if name.startswith(f"{index}/")}
            yield place, kind, own
            row += 1


def _read_block(place: str, archive: bytes, block: Block) -> tuple[list[str], Arrays]:
    """Kind of each recorded event (row) of a block, and the arrays of its archive by name; `place` names it in error messages."""
    arrays = read_arrays(place, "recording", data=archive, remedy=_COPY, kind=RecordingError)
    kinds = [KINDS[k] for k in arrays.pop("kind")]
    if (len(kinds), kinds.count("step")) != (block.rows, block.steps):
        raise RecordingError(
            f"{place}: the block has {len(kinds)} rows, {kinds.count('step')} of step, must be {block.rows} and {block.steps}; {_COPY}"
        )
    return kinds, arrays


def warn_of_end(folder: Path, head: Header) -> None:
    """Issues a `RecordingWarning` if a recording was not closed."""
    if not head["closed"]:
        rows = sum(block.rows for block in find_blocks(folder, head))
        message = f"{folder} was not closed: it ends after {rows} rows, because its process was stopped or is still running"
        warnings.warn(message, RecordingWarning, stacklevel=3)
