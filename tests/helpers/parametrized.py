"""Tests over all combinations of values."""

from collections.abc import Callable, Iterable

import pytest


def every(**values: Iterable) -> Callable:
    """Run a test with every combination of its arguments' values: one `pytest.mark.parametrize` per argument, the first one outermost."""

    def decorate(test: Callable) -> Callable:
        for name in reversed(values):
            test = pytest.mark.parametrize(name, values[name])(test)
        return test

    return decorate
