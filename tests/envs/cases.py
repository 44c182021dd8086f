"""What tests of environments have in common."""

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import pytest
import stepper
from stepper.envs import Observation, Task, square_sum

needs_gymnasiums = pytest.mark.skipif(find_spec("imageio") is None, reason="gymnasium.envs.mujoco needs imageio, which is not installed")
SLIDER = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" gear="1e100"/></actuator></mujoco>"""
SLIDE = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" ctrlrange="-1 1"/></actuator></mujoco>"""


def same(found, expected):
    """Asserts that two infos, observations and the like are the same, bit for bit."""
    assert type(found) is type(expected) or {type(found), type(expected)} <= {np.ndarray, float, bool, int}
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            same(found[key], value)
    elif isinstance(expected, tuple | list):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    elif isinstance(expected, np.ndarray) and expected.dtype == object:
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        np.testing.assert_array_equal(found, expected)


def kolmogorov_smirnov(one, other):
    """Largest distance between the distribution functions of two samples of one size."""
    together = np.sort(np.concatenate([one, other]))
    ranks = [np.searchsorted(np.sort(sample), together, side="right") for sample in (one, other)]
    return np.abs(ranks[0] - ranks[1]).max() / len(one)


@dataclass(frozen=True, kw_only=True)
class Strong(Task):
    """A slider with a motor that is strong enough for a force that no number can hold."""

    frame_skip: int = 1

    def model(self):
        return stepper.load(SLIDER)

    def action_bounds(self, model):
        return np.array([-np.inf]), np.array([np.inf])

    def observations(self):
        return (Observation("qpos"),)

    def reward(self, now):
        return 1.0 - square_sum(now.action), {}


class Slide(Task):
    """The shortest task."""

    frame_skip = 1

    def model(self):
        return stepper.load(SLIDE)

    def observations(self):
        return Observation("qpos"), Observation("qvel")

    def reward(self, now):
        return now.qpos[:, 0], {}
