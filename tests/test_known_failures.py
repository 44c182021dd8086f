"""Known failures: only an error within its bound is expected."""

import math
import re
from pathlib import Path

import pytest
from atlas import scenes
from atlas.known import KNOWN, Bound
from known_failures import KnownFailureError, check_error, known_failure

TESTS = Path(__file__).parent


def test_an_error_within_the_tolerance_passes():
    check_error(1.0, 1.0, 10.0, "")


@pytest.mark.parametrize("error", [1.1, 10.0])
def test_an_error_within_the_bound_is_a_known_failure(error):
    with pytest.raises(KnownFailureError, match="a message"):
        check_error(error, 1.0, 10.0, "a message")


@pytest.mark.parametrize(("error", "bound"), [(10.1, 10.0), (math.inf, 10.0), (math.nan, 10.0), (1.1, None), (math.nan, None)])
def test_any_other_error_fails(error, bound):
    with pytest.raises(AssertionError) as found:
        check_error(error, 1.0, bound, "")
    assert not isinstance(found.value, KnownFailureError)


@known_failure("an error between tolerance and bound")
def test_the_mark_expects_a_known_failure():
    check_error(2.0, 1.0, 3.0, "")


def test_all_expected_failures_have_a_bound():
    """No test has a mark of its own, which would expect any exception."""
    own = re.compile(r"mark\.xfail\b|pytest\.xfail\b")
    files = [file.name for file in TESTS.rglob("*.py") if own.search(file.read_text())]
    assert files == ["known_failures.py"]


def test_bounds_are_finite():
    steps = {dt for scene in scenes.ALL for dt in scene.test_dts}
    for known in KNOWN:
        if isinstance(known.size, Bound):
            low, high = known.dts
            assert all(math.isfinite(known.size.largest(dt)) for dt in steps if low <= dt <= high), known.reason
            assert known.size.because
