"""Files: errors that name them, atomic writing, archives of arrays, and locks of output folders."""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import math
import os
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

LOCK = ".lock"
"""Name of the lock file in an output folder."""
_REMEDIES = {
    errno.ENOENT: "check the name, or give its full path",
    errno.EISDIR: "give the path of a file in it",
    errno.ENOTDIR: "give a path in which every part before the file is a folder",
    errno.EEXIST: "give another path, or remove it",
    errno.EACCES: "change its permissions, or give another path",
    errno.EPERM: "change its permissions, or give another path",
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ENOSPC: "free space on the disk, or give another path",
    errno.EDQUOT: "free space on the disk, or give another path",
    errno.EFBIG: "raise the limit of file sizes, or give another path",
}
"""Remedy for the user by the number of an operating system's error."""
_OTHER_REMEDY = "check the disk, or give another path"
_LARGEST_RATIO = 1032
"""Largest ratio of the sizes before and after compression by DEFLATE, which .npz files use."""


def existing(path: str | os.PathLike[str], what: str) -> Path:
    """Checks that a file exists, and returns its path."""
    file = Path(path)
    # Unlike `Path.exists`, this function is False for names that are too long for the file system.
    if not os.path.exists(file):
        raise FileNotFoundError(_absent(file, what))
    if os.path.isdir(file):
        raise IsADirectoryError(f"the {what} {str(file)!r} is a folder; give the path of a file in it")
    return file


@contextlib.contextmanager
def explained(
    path: str | os.PathLike[str], remedy: str, kind: type[ValueError] = ValueError, *, passing: tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """Context manager in which every error of reading or writing a file names the file, the problem and a remedy.

    Errors of the operating system keep their types (see `os_errors_of`). MemoryError passes unchanged. All other exceptions become errors
    of the class `kind`, unless they are of this class and name the file. The block must contain nothing but work on the contents of one
    file.

    Args:
        path: Path of the file, or a longer description of the place in it.
        remedy: Last part of the message for invalid contents.
        kind: Class of the error for invalid contents.
        passing: Classes of further exceptions that pass unchanged.
    """
    try:
        with os_errors_of(path):
            yield
    except (OSError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, passing) or (isinstance(error, kind) and str(path) in str(error)):
            raise
        raise kind(f"{path}: {_problem(error)}; {remedy}") from error


@contextlib.contextmanager
def os_errors_of(path: str | os.PathLike[str]) -> Iterator[None]:
    """Context manager in which every error of the operating system names a file and a remedy; `path` is the file if the error has none."""
    try:
        yield
    except OSError as error:
        if error.errno is not None:
            # The name of the temporary file of `atomic_write` would mean nothing to users.
            if error.filename is None or os.fsdecode(error.filename) == f"{path}.part":
                error.filename = os.fspath(path)
            error.strerror = _with_remedy(error)
        raise


def _with_remedy(error: OSError) -> str:
    """Text of an error of the operating system with a remedy, which `os_errors_of` may have added already."""
    text = error.strerror or os.strerror(error.errno or 0)
    return text if "; " in text else f"{text}; {_REMEDIES.get(error.errno or 0, _OTHER_REMEDY)}"


def _problem(error: Exception) -> str:
    """Description of an exception from a parser: the invalid byte, the missing key, or the text of the exception."""
    if isinstance(error, UnicodeDecodeError):
        return f"it is not text in UTF-8, from byte {error.start} on"
    if isinstance(error, KeyError) and error.args:
        return f"{error.args[0]} is missing"
    return " ".join(str(error).split()) or type(error).__name__


def read_text(path: Path, what: str, kind: type[ValueError] = ValueError) -> str:
    """Text of a file in UTF-8, without a byte order mark."""
    with explained(path, f"give a {what} file in UTF-8", kind):
        return existing(path, what).read_text(encoding="utf-8-sig")


def read_csv(path: Path, what: str) -> list[list[str]]:
    """Lines of a CSV file, each as a list of its cells; `what` is the kind of file, for error messages."""
    text = read_text(path, what)
    with explained(path, "give a CSV file, with commas between numbers"):
        return list(csv.reader(io.StringIO(text, newline="")))


def read_arrays(
    path: str | os.PathLike[str],
    what: str,
    *,
    data: bytes | None = None,
    remedy: str = "copy it again, or give an .npz file of numpy.savez",
    kind: type[ValueError] = ValueError,
) -> dict[str, np.ndarray[Any, Any]]:
    """Arrays of an .npz file by name. The file cannot run code, and memory is allocated only for numbers that the file contains.

    Args:
        path: The file, or the place in a file for error messages.
        what: Kind of file, for the error message: "policy".
        data: Contents of the file; None reads them from `path`.
        remedy: Last part of the message for a damaged file or another kind of file.
        kind: Class of the error for such a file.
    """
    with explained(path, remedy, kind):
        data = existing(path, what).read_bytes() if data is None else data
        if not zipfile.is_zipfile(io.BytesIO(data)):
            raise ValueError("it is not an .npz file, or is cut off")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            if too_large := [name for name, info in members.items() if info.file_size > _LARGEST_RATIO * len(data)]:
                raise ValueError(f"the array {too_large[0]!r} has more bytes than a file of {len(data)} bytes can have")
            return {name: _read_array(archive, info, name) for name, info in members.items()}


def check_archive(path: Path) -> None:
    """Raises ValueError if a ZIP file, such as a checkpoint of PyTorch, is cut off or damaged. It reads the whole file."""
    if not zipfile.is_zipfile(path):
        raise ValueError(f"it is cut off or damaged: it has {os.path.getsize(path)} bytes, which are no archive")
    with zipfile.ZipFile(path) as archive:
        if damaged := archive.testzip():
            raise ValueError(f"it is damaged: its part {damaged!r} has another checksum")


def _read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> np.ndarray[Any, Any]:
    """Array in a member of an .npz file, after a check that the member has as many bytes as the array's shape requires."""
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read_header(stream)
        if dtype.hasobject:
            raise ValueError(f"the array {name!r} has Python objects, must have numbers: save numpy.asarray(..., dtype=float)")
        if math.prod(shape) * dtype.itemsize != info.file_size - stream.tell():
            raise ValueError(f"the array {name!r} has the shape {shape}, but another number of bytes")
    with archive.open(info) as stream:
        array: np.ndarray[Any, Any] = np.lib.format.read_array(stream, allow_pickle=False)
        return array


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[BinaryIO]:
    """Context manager that writes a file atomically, and creates its folder.

    The new file replaces the old one when the `with` block ends. After an exception in the block, the old file is unchanged. Errors of the
    operating system name the file.

    Yields:
        Binary stream of a temporary file in the same folder, for writing and reading.
    """
    partial = path.with_name(f"{path.name}.part")
    try:
        with os_errors_of(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("w+b") as stream:
                yield stream
            partial.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> Path:
    """Writes a text to a file in UTF-8, atomically, and returns the path."""
    with atomic_write(path) as stream:
        stream.write(text.encode())
    return path


def write_csv(path: Path, rows: Iterable[Iterable[Any]], notes: str = "") -> Path:
    """Writes rows to a CSV file after lines of notes, atomically, and returns the path."""
    text = io.StringIO(newline="")
    text.write(notes)
    csv.writer(text).writerows(rows)
    return write_text(path, text.getvalue())


def write_arrays(path: Path, arrays: Mapping[str, Any], *, compressed: bool = False) -> Path:
    """Writes arrays to an .npz file by name, atomically, and returns the path."""
    with atomic_write(path) as stream:
        # `**` passes the arrays by name, because names with dots cannot be written as arguments.
        (np.savez_compressed if compressed else np.savez)(stream, **arrays)
    return path


def write_figure(path: Path, figure: Any, **settings: Any) -> Path:
    """Writes a figure of Matplotlib to a file, atomically, and returns the path; `settings` are arguments of `savefig`."""
    with atomic_write(path) as stream:
        figure.savefig(stream, format=path.suffix.removeprefix(".") or "png", **settings)
    return path


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Context manager that creates an output folder, and locks it against all other runs until the end of the block.

    The lock is a file of SQLite, which every platform locks alike, and which the operating system unlocks when a process ends.

    Yields:
        The folder.

    Raises:
        BlockingIOError: Another run writes to the folder.
        OSError: The folder cannot be created, or its file system has no locks.
    """
    with contextlib.closing(lock_of(folder)):
        yield folder


def lock_of(folder: Path) -> Any:
    """Lock of an output folder, as a connection to a locked SQLite file; see `locked`. Its method `close` unlocks the folder."""
    import sqlite3  # noqa: PLC0415  (slow to import, and not used by `import stepper`)

    with os_errors_of(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as opened:
        try:
            # A recording may be closed by another thread than the one that began it.
            lock = sqlite3.connect(folder / LOCK, timeout=0.0, isolation_level=None, check_same_thread=False)
            opened.callback(lock.close)
            # Without a journal, SQLite writes nothing, so that a full disk can be locked too.
            lock.execute("PRAGMA journal_mode = MEMORY")
            lock.execute("BEGIN EXCLUSIVE")
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
                raise BlockingIOError(f"{folder}: another run writes to this folder; wait for it, or choose another folder") from None
            raise OSError(
                f"{folder / LOCK} cannot be locked ({error}); choose a folder that can be written, on a file system with locks"
            ) from error
        opened.pop_all()
    return lock


def os_error_message(error: OSError) -> str:
    """Error message for users from an error of the operating system: the file, the problem and the remedy, without the error number."""
    if error.errno is None or error.filename is None:
        return str(error)
    name = os.fsdecode(error.filename)
    if isinstance(error, FileNotFoundError):
        return _absent(Path(name), "file")
    text = _with_remedy(error)
    return f"{shortened(name)!r} cannot be used: {text[:1].lower()}{text[1:]}"


def shortened(text: str) -> str:
    """Text for a message; of a text with more than 200 characters, its beginning and its end."""
    return text if len(text) <= 200 else f"{text[:100]}...{text[-100:]}"


def _absent(file: Path, what: str) -> str:
    """Text of the error for a missing file; `what` is the kind of file, such as "model"."""
    kind = what if what == "file" else f"{what} file"
    place = "" if file.is_absolute() else f" in {Path.cwd()}"
    return f"there is no {kind} {shortened(str(file))!r}{place}; check the name, or give its full path"
