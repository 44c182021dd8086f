"""What an experiment says while it runs, and of what it wrote."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from stepper.shared.machine import require

Tick = Callable[[str, float], None]
"""Called with what is being done and the fraction done, never while something is timed."""


@contextlib.contextmanager
def progress() -> Iterator[Tick]:
    """A progress bar that draws itself only when told, so that it never runs while something is timed.

    Yields:
        A function of (what is being done, fraction done).
    """
    bars = require("rich.progress", "to show progress")
    with bars.Progress(auto_refresh=False, transient=False) as bar:
        tasks: dict[str, Any] = {}

        def tick(what: str, done: float) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=1.0)
            bar.update(tasks[what], completed=done)
            bar.refresh()

        yield tick


def show_files(paths: Sequence[Path]) -> None:
    """Prints what was written.

    Args:
        paths: The files.
    """
    for path in paths:
        print(f"wrote {path}")
