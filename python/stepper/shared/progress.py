"""Progress of a long call: how it tells its caller what it is doing."""

from __future__ import annotations

from collections.abc import Callable

Tick = Callable[[str, float], None]
"""Called with what is being done and the fraction done, never while something is timed."""


def silent(what: str, done: float) -> None:
    """A `Tick` without output."""
