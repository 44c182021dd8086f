"""Journal of a study: an SQLite file with the rows (results) of finished episodes.

Each call of `append` is one transaction with the rows of one batch. A process that is killed while it writes loses these rows, and the next
run repeats the batch. Other processes may read the file at any time.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper.lab.study.document import check_pages
from stepper.shared.arguments import path_of
from stepper.shared.files import explained, locked, write_arrays, write_csv, write_text

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

Row = dict[str, Any]
"""Result of one episode, by name: key, setting, parameters, episode, seed, outcomes, success, quality, settings, resolved_settings."""
_VERSION = 1
"""Version of the journal's database tables, which is stored in the header of the SQLite file."""
_TABLES = (
    "CREATE TABLE study (name TEXT NOT NULL)",
    "CREATE TABLE rows (key TEXT NOT NULL PRIMARY KEY, row TEXT NOT NULL, crc INTEGER NOT NULL)",
    f"PRAGMA user_version = {_VERSION}",
)
_RESTART = "restore the file, or delete it to run the study from the start"


def diverged(row: Row) -> bool:
    """Whether an episode diverged. It then has no outcome and counts as a failure."""
    return bool(int(row["quality"]["status"]) & int(Status.NON_FINITE))


class JournalError(ValueError):
    """A journal cannot be used.

    It is damaged, belongs to another study, or has another version of the tables.
    """


class Journal:
    """Journal that is open for writing. The lock of its folder allows one writer at a time; others may read it with `rows_of`.

    The attribute `rows` has all rows by key.

    Args:
        path: The file, which is created with its folder if it does not exist.
        study: Name of the study.

    Raises:
        JournalError: The journal is damaged, belongs to another study, or has another version of the tables.
    """

    def __init__(self, path: Path, study: str):
        self.path = path
        with contextlib.ExitStack() as opened:
            with _explained(path):
                self._file = opened.enter_context(contextlib.closing(sqlite3.connect(path)))
                # Readers and the writer do not wait for one another; a commit is on the disk when it returns.
                for pragma in ("journal_mode = WAL", "synchronous = FULL"):
                    self._file.execute(f"PRAGMA {pragma}")
                _create(self._file, study)
                self.rows = {row["key"]: row for row in _read(self._file, path, study)}
            self._opened = opened.pop_all()

    def append(self, rows: Iterable[Row]) -> None:
        """Writes results of episodes (rows), each with its "key", as one transaction, and waits until they are on the disk."""
        lines = [(row["key"], text := json.dumps(row, separators=(",", ":")), zlib.crc32(text.encode())) for row in rows]
        with _explained(self.path), self._file:
            self._file.executemany("INSERT INTO rows VALUES (?, ?, ?)", lines)
        # The rows are parsed from JSON, so that they equal those that a later run reads.
        self.rows |= {key: json.loads(text) for key, text, _ in lines}

    def close(self) -> None:
        """Closes the journal."""
        self._opened.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def rows_of(path: Path, study: str | None = None) -> list[Row]:
    """Rows of a journal, also while another process is writing it; empty if there is no such file.

    Raises:
        JournalError: The journal is damaged, belongs to another study, or has another version of the tables.
    """
    if not path.exists():
        return []
    with _explained(path), contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", uri=True)) as file:
        return list(_read(file, path, study)) if _has_tables(file) else []


def _has_tables(file: sqlite3.Connection) -> bool:
    """Whether the database has its tables. A process may have been killed before it created them."""
    return bool(file.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0])


def _create(file: sqlite3.Connection, study: str) -> None:
    """Creates the tables of a new journal in one transaction."""
    if _has_tables(file):
        return
    with file:
        file.execute("BEGIN")
        for statement in _TABLES:
            file.execute(statement)
        file.execute("INSERT INTO study VALUES (?)", [study])


def _read(file: sqlite3.Connection, path: Path, study: str | None) -> Iterator[Row]:
    """Yields the rows of a journal in the order in which they were written, after a check of version and study."""
    if (version := file.execute("PRAGMA user_version").fetchone()[0]) != _VERSION:
        raise JournalError(
            f"{path} is a journal of version {version}, must be version {_VERSION}: delete it to run the study from the start, or use the "
            "version of stepper that wrote it"
        )
    (name,) = file.execute("SELECT name FROM study").fetchone()
    if study not in (None, name):
        raise JournalError(
            f"{path} is the journal of study {name!r}, not of {study!r}: choose another folder for the results, or delete it"
        )
    for number, (text, crc) in enumerate(file.execute("SELECT row, crc FROM rows ORDER BY rowid"), 1):
        if not isinstance(text, str) or zlib.crc32(text.encode()) != crc:
            raise JournalError(f"{path}, row {number} is damaged: {_RESTART}")
        yield json.loads(text)


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Context manager that raises JournalError with a remedy in place of SQLite's errors."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise JournalError(f"{path}: SQLite cannot use the file ({error}): check its permissions and the space on the disk") from error
    except sqlite3.DatabaseError as error:
        raise JournalError(f"{path} is no journal of a study, or is damaged ({error}): {_RESTART}") from error


SETTINGS, JOURNAL = "resolved_settings.json", "journal.sqlite"
"""Names of the files in a study's folder with the provenance of the rows, and with the rows (results of episodes)."""


class Results:
    """Output folder of a study, as a context manager. Until it is closed, it is locked for other runs.

    Args:
        study: The study.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.

    Raises:
        BlockingIOError: Another run writes to the folder.
        JournalError: The journal cannot be used.
    """

    def __init__(self, study: Study, out: str | os.PathLike[str]):
        check_pages()
        self.folder = path_of("out", out) / study.name
        with contextlib.ExitStack() as opened:
            opened.enter_context(locked(self.folder))
            self.journal = opened.enter_context(Journal(self.folder / JOURNAL, study.name))
            self._write_settings(study)
            self._opened = opened.pop_all()

    def _write_settings(self, study: Study) -> None:
        """Adds the study's provenance (model, versions, digests) as an entry to resolved_settings.json.

        The key of the entry is its SHA-256, shortened.
        """
        file = self.folder / SETTINGS
        with explained(file, "restore the file, or delete it with the journal to run the study from the start"):
            entries: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        text = json.dumps(study.resolved_settings(), sort_keys=True, default=str)
        name = hashlib.sha256(text.encode()).hexdigest()[:16]
        if name in entries:
            return
        write_text(file, json.dumps(entries | {name: json.loads(text)}, indent=2, sort_keys=True) + "\n")

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._opened.close()


class Table:
    """Table of n episodes of a study. Its columns are arrays (n,), as `table["outcome.lifted"]`.

    Columns:

    * "setting", "episode", "seed": name of the settings, number and seed of the episode
    * "parameters.NAME": value of a parameter; NaN (or "" among texts) if the parameter did not change the model's number
    * "outcome.NAME": value of an outcome
    * "success": 1, 0, or -1 if the study has no condition of success
    * "cause", in tables of `report`: cause of a failure; "" for a success, and for a failure in MuJoCo that was not examined
    * "status": flags of `stepper.Status` over the episode
    * "residual" (m/s), "max_penetration" (m), "max_limit_violation" (rad or m), "max_equality_violation" (m or rad): largest in the episode
    * "settings.NAME": setting of the engine
    * "resolved_settings": key of an entry in resolved_settings.json, with model, versions and digests

    Args:
        rows: Rows of the journal.
        causes: Causes of failures, by the keys of their rows; None leaves the column out.
    """

    def __init__(self, rows: Sequence[Row], causes: Mapping[str, str] | None = None):
        self.rows = list(rows)
        flat = [_flat(row, None if causes is None else causes.get(row["key"], "")) for row in self.rows]
        names = list(dict.fromkeys(name for row in flat for name in row))
        self.columns: dict[str, NDArray[Any]] = {name: _column([row.get(name) for row in flat]) for name in names}

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def save(self, folder: Path, name: str = "table") -> list[Path]:
        """Writes NAME.csv and NAME.npz, and returns their paths."""
        rows = zip(*(column.tolist() for column in self.columns.values()), strict=True)
        return [write_csv(folder / f"{name}.csv", [self.columns, *rows]), write_arrays(folder / f"{name}.npz", self.columns)]


def _flat(row: Row, cause: str | None) -> dict[str, Any]:
    """Row of the journal as a flat dictionary with the names of the table's columns."""
    success = row["success"]
    return {
        "setting": row["setting"],
        "episode": row["episode"],
        "seed": row["seed"],
        **{f"parameters.{name}": value for name, value in row["parameters"].items()},
        **{f"outcome.{name}": value for name, value in row["outcomes"].items()},
        "success": -1 if success is None else int(success),
        **({} if cause is None else {"cause": cause}),
        **row["quality"],
        **{f"settings.{name}": value for name, value in row["settings"].items()},
        "resolved_settings": row["resolved_settings"],
    }


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Column of a table as an array of numbers or of words. Missing values (None) become NaN among numbers, and "" among words."""
    given = [value for value in values if value is not None]
    if any(isinstance(value, str) for value in given):
        return np.array(["" if value is None else str(value) for value in values])
    if given and len(given) == len(values) and all(isinstance(value, int) for value in given):
        return np.array(values, np.int64)
    return np.array([np.nan if value is None else float(value) for value in values])
