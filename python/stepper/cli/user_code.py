"""Error messages for exceptions in files of the user: studies, controllers, tasks."""

from __future__ import annotations

import sysconfig
import traceback
from pathlib import Path

_STEPPER_FOLDER = Path(__file__).parents[1]
"""Folder of the package stepper."""
_PACKAGES = {"site-packages", "dist-packages"}
"""Names of folders with installed packages."""


def error_in_user_code(error: BaseException) -> str:
    """Error message for an exception in a file of the user: file, line, text of the exception, and the lines of the user's calls.

    The message is "" if no file of the user is in the traceback.
    """
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if _is_of_user(frame.filename)]
    if isinstance(error, SyntaxError) and error.filename is not None and _is_of_user(error.filename):
        # The traceback ends in the import of the file.
        frames.append(traceback.FrameSummary(error.filename, error.lineno, "<module>", line=(error.text or "").strip(), lookup_line=False))
    if not frames:
        return ""
    lines = [f"{_place(frames[-1])}: {_text(error)}"]
    lines += [f"  {_place(frame)}: {frame.line}" for frame in frames]
    return "\n".join(lines)


def _is_of_user(file: str) -> bool:
    """Whether a file is neither of stepper, nor of Python, nor of an installed package."""
    path = Path(file)
    if not path.exists():
        return False
    path = path.resolve()
    standard = Path(sysconfig.get_paths()["stdlib"]).resolve()
    return not path.is_relative_to(_STEPPER_FOLDER) and not path.is_relative_to(standard) and not _PACKAGES & set(path.parts)


def _place(frame: traceback.FrameSummary) -> str:
    """File, line and function of a traceback frame, as text. Files in the working directory have a relative path."""
    path = Path(frame.filename).resolve()
    shown = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f"{shown}, line {frame.lineno}" + ("" if frame.name == "<module>" else f", in {frame.name}")


def message_of(error: BaseException) -> str:
    """Message of an exception."""
    # KeyError puts its text in quotes; a text with spaces is a message, not a key.
    is_message = isinstance(error, KeyError) and error.args and " " in str(error.args[0])
    return str(error.args[0]) if is_message else str(error)


def _text(error: BaseException) -> str:
    """Type and message of an exception."""
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg}"
    text = message_of(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
