"""The journal of a study: rows that were finished, in a file that only grows.

A line is a CRC-32 in hexadecimal, a blank, and a JSON object. What a process was writing when it was killed is at the end of the file,
without its newline or with a CRC that does not fit: opening the journal cuts it off. A line that does not fit anywhere else is damage, and
an error.
"""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from stepper._status import Status

Row = dict[str, Any]


def diverged(row: Row) -> bool:
    """Whether an episode is lost to its engine: it has no outcome, and is no success."""
    return bool(int(row["certificate"]["status"]) & Status.NON_FINITE)


class JournalError(ValueError):
    """A journal that is damaged, or that another process writes."""


class Journal:
    """Rows by their key, on disk before `append` returns.

    On POSIX one process at a time has it open. Elsewhere nothing keeps a second one out: run one study in a folder at a time there.

    Args:
        path: The file, made with its folder if it is not there.

    Raises:
        JournalError: Another process has it open (POSIX), or a line before the last is damaged.
        OSError: It cannot be read, written or locked.
    """

    def __init__(self, path: Path):
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        self._file: BinaryIO = path.open("a+b")
        try:
            _lock(self._file, path)
            self.rows = self._read()
        except BaseException:
            self._file.close()
            raise
        if new:
            _sync_folder(path.parent)

    def _read(self) -> dict[str, Row]:
        self._file.seek(0)
        data = self._file.read()
        rows: dict[str, Row] = {}
        at = 0
        for number, line in enumerate(data.splitlines(keepends=True), 1):
            row = _row_of(line)
            if row is None:
                if at + len(line) < len(data):
                    raise JournalError(f"{self.path}, line {number}: it is damaged; restore the file, or remove it to run the study anew")
                self._file.truncate(at)
                break
            rows[row["key"]] = row
            at += len(line)
        return rows

    def append(self, rows: Iterable[Row]) -> None:
        """Writes rows, each with its "key", and waits until they are on the disk."""
        rows = list(rows)
        self._file.write(b"".join(_line_of(row) for row in rows))
        self._file.flush()
        os.fsync(self._file.fileno())
        # As they will be read.
        self.rows |= {row["key"]: json.loads(json.dumps(row)) for row in rows}

    def close(self) -> None:
        """Lets other processes have it."""
        self._file.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _line_of(row: Row) -> bytes:
    text = json.dumps(row, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _row_of(line: bytes) -> Row | None:
    """The row of a line; None if it is torn."""
    crc, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or crc != b"%08x" % zlib.crc32(text[:-1]):
        return None
    row: Row = json.loads(text)
    return row


def _lock(file: BinaryIO, path: Path) -> None:
    """Keeps other processes out until the file is closed, on POSIX. The system lets go of it when a process dies."""
    try:
        import fcntl  # noqa: PLC0415  (POSIX alone)
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise JournalError(f"{path}: another process is running this study; wait for it, or choose another folder") from error


def _sync_folder(folder: Path) -> None:
    """Puts the name of a new file on the disk too, where the system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def rows_of(path: Path) -> Iterator[Row]:
    """Rows of a journal that is not opened: those before the first line that does not fit."""
    for line in path.read_bytes().splitlines(keepends=True) if path.exists() else ():
        row = _row_of(line)
        if row is None:
            return
        yield row
