"""Command line of stepper, a simulator of rigid bodies in contact."""

from __future__ import annotations

import importlib
import sys
import sysconfig
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from stepper._hints import WrongArgumentError
from stepper._stepper import ModelError
from stepper.shared.files import os_error_message
from stepper.shared.machine import require

if TYPE_CHECKING:
    from typer import Typer

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


COMMANDS = {
    "demo": "commands",
    **dict.fromkeys(("chart", "explain", "report", "sweep", "rank", "calibrate", "tune"), "studies"),
    **dict.fromkeys(("train", "evaluate", "identify", "replay"), "commands"),
    "view": "view",
    "doctor": "commands",
}
"""Module of this folder with the function of each command, by name of the command."""


def application() -> Typer:
    """Typer application with all commands. A function creates the application, because Typer is an optional package."""
    typer = require("typer", "for the command line")
    # Rich would take the brackets of help texts, such as geom_friction[floor], for markup.
    app: Typer = typer.Typer(help=__doc__, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
    for name, module in COMMANDS.items():
        command = getattr(importlib.import_module(f"stepper.cli.{module}"), name)
        if name == "train":
            app.command(name, context_settings={"ignore_unknown_options": True}, add_help_option=False)(command)
        else:
            app.command(name)(command)
    return app


def main() -> None:
    """Entry point of the command `stepper`.

    Errors that a user can correct are printed on stderr without a traceback: as one line, or with the lines of the user's own files.
    """
    try:
        application()()
    except Exception as error:
        text = error_in_user_code(error)
        if not text:
            if not isinstance(error, ImportError | ModelError | KeyError | OSError | WrongArgumentError | ValueError):
                raise
            text = os_error_message(error) if isinstance(error, OSError) else message_of(error)
        print(f"stepper: {text}", file=sys.stderr)
        sys.exit(1)
