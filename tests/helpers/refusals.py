"""Calls that must fail."""

from collections.abc import Callable

import pytest


def raises(error: type[BaseException] | tuple, match: str, call: Callable, /, *args, **kwargs) -> None:
    """Check that a call raises an error whose message matches a pattern: `pytest.raises` on one line."""
    with pytest.raises(error, match=match):
        call(*args, **kwargs)
