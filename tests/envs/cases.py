"""What tests of environments have in common."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

needs_gymnasiums = pytest.mark.skipif(find_spec("imageio") is None, reason="gymnasium.envs.mujoco needs imageio, which is not installed")


def same(found, expected):
    """Asserts that two infos, observations and the like are the same, bit for bit."""
    assert type(found) is type(expected) or {type(found), type(expected)} <= {np.ndarray, float, bool, int}
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            same(found[key], value)
    elif isinstance(expected, tuple):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    elif isinstance(expected, np.ndarray) and expected.dtype == object:
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        np.testing.assert_array_equal(found, expected)
