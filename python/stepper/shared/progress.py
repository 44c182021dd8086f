"""Progress of a long call, reported by a callback."""

from __future__ import annotations

from collections.abc import Callable

Tick = Callable[[str, float], None]
"""Callback with the present work as text and the completed fraction (0 to 1); never called during a time measurement."""


def silent(what: str, done: float) -> None:
    """A callback that prints nothing."""
