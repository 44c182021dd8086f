"""Gymnasium's wrappers of vector environments work around ours."""

import numpy as np
import pytest
from gymnasium.wrappers import vector
from gymnasium.wrappers.vector import DictInfoToList, NormalizeObservation, NormalizeReward, RecordEpisodeStatistics
from stepper.envs import StepperVectorEnv


def run(envs, steps=30):
    """All infos of some steps, and the last observation."""
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


def test_observations_and_rewards_are_normalised():
    envs = NormalizeReward(NormalizeObservation(StepperVectorEnv("HalfCheetah", 32)))
    said = run(envs, 60)
    observations = np.array([step[0] for step in said[30:]])
    assert np.abs(observations.mean((0, 1))).max() < 1.0
    assert 0.3 < observations.std((0, 1)).mean() < 3.0


def test_infos_as_a_list():
    envs = DictInfoToList(StepperVectorEnv("Hopper", 3, autoreset_mode="SameStep", max_episode_steps=5))
    infos = run(envs, 5)[-1][-1]
    assert len(infos) == 3
    assert all(set(info) >= {"x_position", "final_obs", "final_info"} for info in infos)


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
