"""Absent attributes of `now` and of a reset are errors with similar names."""

import numpy as np
import pytest
from cases import Slide
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.task import TaskView


class Wrong:
    @property
    def height(self):
        return [].top


@pytest.mark.parametrize("kind", [Slide, StepperEnv, StepperVectorEnv, TaskView])
def test_an_error_inside_a_property_shows(kind):
    own = type("Own", (Wrong, kind), {})
    with pytest.raises(AttributeError, match=r"^'list' object has no attribute 'top'$"):
        own.__new__(own).height  # noqa: B018


def test_an_absent_attribute_of_a_view_or_a_reset_has_similar_names():
    envs = StepperVectorEnv(Slide(), 2)
    envs.reset(seed=0)
    with pytest.raises(AttributeError, match=r"^a stepper.envs.TaskView has no attribute 'qpso'; did you mean qpos\?$"):
        envs.now.qpso  # noqa: B018
    with pytest.raises(TypeError, match=r"now\['qpos'\] is not defined: quantities are attributes, as now\.qpos, and now\.read"):
        envs.now["qpos"]
    own = type("Own", (Slide,), {"reset": lambda self, reset: reset.qpso})()
    with pytest.raises(AttributeError, match=r"^a stepper.envs.Reset has no attribute 'qpso'; did you mean qpos"):
        StepperVectorEnv(own, 2).reset(seed=0)


def test_the_time_of_an_episode_counts_actions():
    envs = StepperVectorEnv("Hopper", 2, max_episode_steps=3)
    envs.reset(seed=0)
    for _ in range(8):
        envs.step(np.zeros((2, 3)))
        np.testing.assert_array_equal(np.rint(envs.now.time / envs.now.dt), envs.episode_lengths)
