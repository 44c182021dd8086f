"""Command `stepper replay`: repetition of a recording, compared bit for bit."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import RECORDING
from stepper.recording import verify
from stepper.shared.progress import show_progress


def replay(
    recording: Annotated[Path, typer.Argument(help=RECORDING)],
    threads: Annotated[int | None, typer.Option(min=0, help="Number of threads; the default is that of the recording.")] = None,
) -> None:
    """Repeats a recording and compares the results bit for bit. Prints the first step and field that differ."""
    with show_progress() as progress:
        result = verify(recording, threads=threads, progress=progress)
    print(result)
    if not result:
        sys.exit(1)
