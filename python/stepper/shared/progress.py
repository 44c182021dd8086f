"""Terminal output of long calls: progress, and paths of written files."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from stepper.shared.machine import require

ProgressCallback = Callable[[str, float], None]
"""Type of a progress callback. Its arguments are a text that names the work in progress, and the completed fraction (0 to 1).

Functions that measure computing time do not call the callback during a measurement.
"""
_LONGEST_PAUSE = 30.0
"""Longest time between two lines of progress, s."""


def silent(what: str, done: float) -> None:
    """Progress callback that does nothing."""


def progress_lines() -> ProgressCallback:
    """Progress callback that writes lines to stderr, for output to files and pipes: one line per tenth of the work, or every 30 s."""
    last: dict[str, tuple[int, float]] = {}
    first: dict[str, tuple[float, float]] = {}

    def progress(what: str, done: float) -> None:
        tenth, now = int(10 * done + 1e-9), time.monotonic()
        before, when = last.get(what, (-1, now))
        begun, began = first.setdefault(what, (done, now))
        if tenth > before or now - when > _LONGEST_PAUSE:
            print(f"{what}: {100 * done:.0f} %{_remaining(done, done - begun, now - began)}", file=sys.stderr, flush=True)
            last[what] = max(tenth, before), now

    return progress


def _remaining(done: float, made: float, seconds: float) -> str:
    """Text with the estimated remaining time of a long computation, such as ", 40 s left".

    The text is empty if the remaining time is unknown (no progress yet) or below one second.
    """
    left = (1.0 - done) * seconds / made if made > 0 else 0.0
    if left < 1.0:
        return ""
    return f", {left:.0f} s left" if left < 100.0 else f", {left / 60.0:.0f} min left"


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
