"""Terminal output of long calls: progress, and paths of written files."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from stepper.shared.machine import require
from stepper.shared.progress import Tick

__all__ = ["Tick", "progress", "show_files"]

_LONGEST_PAUSE = 30.0
"""Longest time between two lines of progress, s."""


@contextlib.contextmanager
def progress() -> Iterator[Tick]:
    """Context manager that shows progress on stderr, with an estimate of the remaining time.

    It writes only when its callback is called, so that timings are not disturbed. On a terminal it shows a bar. In a file or a pipe it
    writes a line for every tenth, or every half minute.

    Yields:
        Progress callback (text, fraction done).
    """
    bars, consoles = require("rich.progress", "to show progress"), require("rich.console", "to show progress")
    console = consoles.Console(stderr=True)
    if not console.is_terminal:
        yield _lines()
        return
    with bars.Progress(console=console, auto_refresh=False, transient=False) as bar:
        tasks: dict[str, Any] = {}

        def tick(what: str, done: float) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=1.0)
            bar.update(tasks[what], completed=done)
            bar.refresh()

        yield tick


def _lines() -> Tick:
    """Progress callback that writes lines, for files and pipes."""
    last: dict[str, tuple[int, float]] = {}
    first: dict[str, tuple[float, float]] = {}

    def tick(what: str, done: float) -> None:
        tenth, now = int(10 * done + 1e-9), time.monotonic()
        before, when = last.get(what, (-1, now))
        begun, began = first.setdefault(what, (done, now))
        if tenth > before or now - when > _LONGEST_PAUSE:
            print(f"{what}: {100 * done:.0f} %{_remaining(done, done - begun, now - began)}", file=sys.stderr, flush=True)
            last[what] = max(tenth, before), now

    return tick


def _remaining(done: float, made: float, seconds: float) -> str:
    """Text with the estimated remaining time; empty without progress, or below a second.

    Args:
        done: Fraction of the work that is done.
        made: Fraction that was done since the first report.
        seconds: Time since the first report, s.
    """
    left = (1.0 - done) * seconds / made if made > 0 else 0.0
    if left < 1.0:
        return ""
    return f", {left:.0f} s left" if left < 100.0 else f", {left / 60.0:.0f} min left"


def show_files(paths: Sequence[Path]) -> None:
    """Print the paths of written files."""
    for path in paths:
        print(f"wrote {path}", flush=True)
