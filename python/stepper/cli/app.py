"""Command line of stepper, a simulator of rigid bodies in contact."""

from __future__ import annotations

import inspect
import sys
from typing import TYPE_CHECKING

from stepper._hints import WrongArgumentError
from stepper._stepper import ModelError
from stepper.cli import calibrate, chart, compare, demo, doctor, evaluate, explain, identify, rank, replay, report, sweep, train, tune, view
from stepper.cli.user_code import error_in_user_code, message_of
from stepper.shared.files import os_error_message
from stepper.shared.machine import require

if TYPE_CHECKING:
    from typer import Typer

COMMANDS = (demo, chart, compare, explain, report, sweep, rank, calibrate, tune, train, evaluate, identify, replay, view, doctor)


def application(*, escaped: bool = True) -> Typer:
    """Typer application with all commands. A function creates the application, because Typer is an optional package.

    Args:
        escaped: Whether brackets of help texts, such as those in geom_friction[floor], are escaped for Rich, which takes them for markup.
    """
    typer = require("typer", "for the command line")
    app: Typer = typer.Typer(help=__doc__, no_args_is_help=True, pretty_exceptions_enable=False)
    for command in COMMANDS:
        command.register(app, typer)
    if escaped:
        _escape(app)
    return app


def _escape(app: Typer) -> None:
    """Escape the brackets of all help texts of an application for Rich."""
    escape = require("rich.markup", "for the command line").escape
    for command in app.registered_commands:
        command.help = escape(command.help or inspect.getdoc(command.callback) or "")
        if command.callback is not None:
            for parameter in inspect.signature(command.callback).parameters.values():
                if getattr(parameter.default, "help", None):
                    parameter.default.help = escape(parameter.default.help)


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
