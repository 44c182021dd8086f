"""Calls that must fail, and tests over all combinations of values, on one line each."""

from collections.abc import Callable, Iterable

import pytest


def raises(error: type[BaseException] | tuple, match: str, call: Callable, /, *args, **kwargs) -> None:
    """Check that a call raises an error whose message matches a pattern, as `pytest.raises` does."""
    with pytest.raises(error, match=match):
        call(*args, **kwargs)


def every(**values: Iterable) -> Callable:
    """Run a test with every combination of its arguments' values: one `pytest.mark.parametrize` per argument, the first one outermost."""

    def decorate(test: Callable) -> Callable:
        for name in reversed(values):
            test = pytest.mark.parametrize(name, values[name])(test)
        return test

    return decorate
