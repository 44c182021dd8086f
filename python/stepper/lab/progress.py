"""Terminal output of long calls: progress, and paths of written files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, progress_lines

__all__ = ["ProgressCallback", "show_files", "show_progress"]


@contextlib.contextmanager
def show_progress() -> Iterator[ProgressCallback]:
    """Context manager that shows progress on stderr, with an estimate of the remaining time.

    Progress is written only when the callback is called, so that timings are not disturbed. On a terminal it is a bar. In a file or a pipe
    it is a line for every tenth of the work, or after half a minute without a line.

    Yields:
        Progress callback (text, fraction done).
    """
    bars, consoles = require("rich.progress", "to show progress"), require("rich.console", "to show progress")
    console = consoles.Console(stderr=True)
    if not console.is_terminal:
        yield progress_lines()
        return
    with bars.Progress(console=console, auto_refresh=False, transient=False) as bar:
        tasks: dict[str, Any] = {}

        def report(what: str, done: float) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=1.0)
            bar.update(tasks[what], completed=done)
            bar.refresh()

        yield report


def show_files(paths: Sequence[Path]) -> None:
    """Prints the paths of written files."""
    for path in paths:
        print(f"wrote {path}", flush=True)
