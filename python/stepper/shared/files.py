"""Files: check that they exist, write them atomically, and explain errors of the operating system."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO


def existing(path: str | os.PathLike[str], what: str) -> Path:
    """Checks that a file exists, and returns its path.

    Args:
        path: The path.
        what: Kind of file, for the error message: "model".

    Raises:
        FileNotFoundError: The file does not exist; the message names the file, the working folder and the remedy.
        IsADirectoryError: The path is a folder.
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(_absent(file, what))
    if file.is_dir():
        raise IsADirectoryError(f"the {what} {str(file)!r} is a folder; give the path of a file in it")
    return file


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[BinaryIO]:
    """Context manager that writes a file atomically.

    The new file replaces the old one when the `with` block ends. After an exception in the block, the old file is unchanged.

    Args:
        path: Path of the file.

    Yields:
        Binary stream of a temporary file in the same folder, for writing and reading.
    """
    partial = path.with_name(f"{path.name}.part")
    try:
        with partial.open("w+b") as stream:
            yield stream
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def os_error_message(error: OSError) -> str:
    """Error message for users from an error of the operating system: the file, the problem and the remedy, without the error number."""
    if error.errno is None or error.filename is None:
        return str(error)
    name = os.fsdecode(error.filename)
    if isinstance(error, FileNotFoundError):
        return _absent(Path(name), "file")
    remedies = {
        IsADirectoryError: "give the path of a file in it",
        NotADirectoryError: "give a path in which every part before the file is a folder",
        FileExistsError: "give another path, or remove it",
        PermissionError: "change its permissions, or give another path",
    }
    remedy = next((text for kind, text in remedies.items() if isinstance(error, kind)), "check the disk, or give another path")
    return f"{name!r} cannot be used: {os.strerror(error.errno).lower()}; {remedy}"


def _absent(file: Path, what: str) -> str:
    """Text of the error for a missing file; `what` is the kind of file, such as "model"."""
    kind = what if what == "file" else f"{what} file"
    place = "" if file.is_absolute() else f" in {Path.cwd()}"
    return f"there is no {kind} {str(file)!r}{place}; check the name, or give its full path"
