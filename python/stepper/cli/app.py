"""Command line of stepper, a simulator of rigid bodies in contact."""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

from stepper._hints import WrongArgumentError
from stepper._stepper import ModelError
from stepper.cli.user_code import error_in_user_code, message_of
from stepper.shared.files import os_error_message
from stepper.shared.machine import require

if TYPE_CHECKING:
    from typer import Typer

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
