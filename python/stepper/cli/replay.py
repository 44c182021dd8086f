"""Command `stepper replay`: repetition of a recording, compared bit for bit."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper import recording
from stepper.cli.options import RECORDING
from stepper.lab.progress import show_progress

if TYPE_CHECKING:
    from typer import Typer


def replay(folder: Path, threads: int | None) -> None:
    """Repeats a recording and compares the results bit for bit. Prints the first step and field that differ."""
    with show_progress() as progress:
        result = recording.verify(folder, threads=threads, progress=progress)
    print(result)
    if not result:
        sys.exit(1)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `replay` to the Typer application; `typer` is the module."""
    folder = typer.Argument(help=RECORDING)

    @app.command("replay", help=replay.__doc__)
    def _(
        recording: Path = folder,
        threads: int | None = typer.Option(None, min=0, help="Number of threads; the default is that of the recording."),
    ) -> None:
        replay(recording, threads)
