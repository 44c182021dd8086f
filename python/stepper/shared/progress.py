"""Type of the callbacks that report the progress of a long call."""

from __future__ import annotations

from collections.abc import Callable

Tick = Callable[[str, float], None]
"""Callback with a text that names the present work, and the completed fraction (0 to 1). It is never called during a time measurement."""


def silent(what: str, done: float) -> None:
    """Progress callback that does nothing."""
