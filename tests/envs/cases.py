"""Tasks that tests run over, and what they need."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
import stepper
from stepper.envs import TASKS

DERIVED = {"Ant", "Humanoid", "HumanoidStandup", "InvertedDoublePendulum"}
"""Tasks that observe what a stepper derives from its state."""
needs_quantities = pytest.mark.skipif(
    not hasattr(stepper.Stepper, "subtree_com"), reason="this build of stepper has no quantities of bodies"
)
needs_gymnasiums = pytest.mark.skipif(find_spec("imageio") is None, reason="gymnasium.envs.mujoco needs imageio, which is not installed")


def cases(names=TASKS):
    """Names of tasks as parameters."""
    return [pytest.param(name, marks=[needs_quantities] if name in DERIVED else []) for name in sorted(names)]


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
