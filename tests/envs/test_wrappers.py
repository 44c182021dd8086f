"""Gymnasium's wrappers of vector environments work around ours."""

import numpy as np
import pytest
from gymnasium.wrappers import vector
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stepper.envs import StepperVectorEnv


def run(envs, steps=30):
    """Observations, rewards, flags and infos of some steps."""
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    said = [envs.step(rng.uniform(-1, 1, envs.action_space.shape)) for _ in range(steps)]
    return said


def test_a_mask_reaches_wrappers():
    envs = RecordEpisodeStatistics(StepperVectorEnv("Hopper", 4, autoreset_mode="Disabled"))
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((4, 3)))
    envs.reset(options={"reset_mask": np.arange(4) == 2})
    np.testing.assert_array_equal(envs.episode_lengths, [3, 3, 0, 3])


WRAPPERS = {
    "ClipAction": {},
    "RecordEpisodeStatistics": {},
    "NormalizeReward": {},
    "TransformReward": {"func": lambda reward: reward},
    "NormalizeObservation": {"refused": ("SAME_STEP", "DISABLED")},
    "TransformObservation": {"func": lambda observation: observation, "refused": ("SAME_STEP",)},
    "DtypeObservation": {"dtype": np.float32, "refused": ("SAME_STEP",)},
    "FlattenObservation": {"refused": ("SAME_STEP",)},
}


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
@pytest.mark.parametrize("name", WRAPPERS)
def test_wrappers_refuse_the_modes_that_the_page_of_adapters_names(name, mode):
    """By a ValueError in Gymnasium 1.4, by an AssertionError in 1.2."""
    arguments = dict(WRAPPERS[name])
    refused = mode in arguments.pop("refused", ())
    envs = StepperVectorEnv("Hopper", 2, autoreset_mode=mode)
    if not refused:
        assert len(run(getattr(vector, name)(envs, **arguments), 5)) == 5
        return
    with pytest.raises((ValueError, AssertionError)):
        getattr(vector, name)(envs, **arguments)
