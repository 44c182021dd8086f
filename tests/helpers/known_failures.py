"""Failures that are known: a test expects an error above its tolerance, and within a bound."""

import pytest


class KnownFailureError(AssertionError):
    """An error above its tolerance and within the bound of its known failure."""


def known_failure(reason: str) -> pytest.MarkDecorator:
    """Mark of a test that must end in a `KnownFailureError`. A pass, another exception or an error above the bound fails it."""
    return pytest.mark.xfail(reason=reason, raises=KnownFailureError, strict=True)


def check_error(error: float, tolerance: float, bound: float | None, message: str) -> None:
    """Compare an error with its tolerance, and with the bound of a known failure.

    Args:
        error: Error, in any unit. NaN is above every bound.
        tolerance: Largest error that holds, in that unit.
        bound: Largest error of the known failure, in that unit; None if the error must be within the tolerance.
        message: Description of both.

    Raises:
        KnownFailureError: The error is between tolerance and bound.
        AssertionError: The error is above both, or NaN.
    """
    if error <= tolerance:
        return
    if bound is not None and error <= bound:
        raise KnownFailureError(f"{error:g}, allowed {tolerance:g}: {message}")
    assert bound is None, f"{error:g} is above {bound:g}, the bound of a known failure: {message}"
    raise AssertionError(f"{error:g}, allowed {tolerance:g}: {message}")
