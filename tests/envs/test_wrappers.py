"""Gymnasium's wrappers of vector environments work around ours."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector
from gymnasium.wrappers.vector import DictInfoToList, NormalizeObservation, NormalizeReward, RecordEpisodeStatistics
from stepper.envs import StepperVectorEnv


def run(envs, steps=30):
    """All infos of some steps, and the last observation."""
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    said = [envs.step(rng.uniform(-1, 1, envs.action_space.shape)) for _ in range(steps)]
    return said


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_statistics_of_episodes(mode):
    envs = RecordEpisodeStatistics(StepperVectorEnv("Hopper", 4, max_episode_steps=8, autoreset_mode=mode))
    said = run(envs)
    lengths = [info["episode"]["l"][info["_episode"]] for *_, info in said if "episode" in info]
    assert np.concatenate(lengths).max() == 8
    assert envs.episode_count == sum(map(len, lengths))


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


def test_a_single_environment_in_gymnasiums_vectors():
    envs = gymnasium.make_vec("stepper/Hopper-v5", num_envs=3, vectorization_mode="sync")
    own = gymnasium.make_vec("stepper/Hopper-v5", num_envs=3)
    np.testing.assert_array_equal(envs.reset(seed=4)[0], own.reset(seed=4)[0])


SAME = {"func": lambda values: values}
OF_OBSERVATIONS = {
    "NormalizeObservation": {},
    "TransformObservation": SAME,
    "RescaleObservation": {"min_obs": -1.0, "max_obs": 1.0},
    "FlattenObservation": {},
    "DtypeObservation": {"dtype": np.float32},
}
OF_OTHERS = {"ClipAction": {}, "NormalizeReward": {}, "RecordEpisodeStatistics": {}, "TransformReward": SAME}


def wrapped(name, **settings):
    envs = StepperVectorEnv("Hopper", 2, autoreset_mode="SAME_STEP", max_episode_steps=3)
    return getattr(gymnasium.wrappers.vector, name)(envs, **settings)


@pytest.mark.parametrize("name", OF_OBSERVATIONS)
def test_wrappers_of_observations_refuse_a_reset_in_the_same_step(name):
    """As the page of adapters says; Gymnasium 1.2 has an assertion without a text."""
    with pytest.raises((ValueError, AssertionError)):
        wrapped(name, **OF_OBSERVATIONS[name])


@pytest.mark.parametrize("name", OF_OTHERS)
def test_other_wrappers_take_a_reset_in_the_same_step(name):
    assert len(run(wrapped(name, **OF_OTHERS[name]), 5)) == 5


def test_the_step_after_an_episode_ignores_its_action_and_gives_no_reward():
    """These are the samples that a learner leaves out, those with `dones[t] == 1`."""
    given = [StepperVectorEnv("Hopper", 2, max_episode_steps=3) for _ in range(2)]
    for envs in given:
        envs.reset(seed=0)
        ended = [envs.step(np.zeros((2, 3))) for _ in range(3)][-1]
        assert ended[3].all()
    after = [envs.step(np.full((2, 3), action)) for envs, action in zip(given, (-1.0, 1.0), strict=True)]
    np.testing.assert_array_equal(after[0][0], after[1][0])
    for _, reward, terminated, truncated, _ in after:
        assert not (reward.any() or terminated.any() or truncated.any())


WRAPPERS = {
    "ClipAction": {},
    "RecordEpisodeStatistics": {},
    "NormalizeReward": {},
    "TransformReward": {"func": lambda reward: reward},
    "NormalizeObservation": {"refused": ("SAME_STEP", "DISABLED")},
    "TransformObservation": {"func": lambda observation: observation, "refused": ("SAME_STEP",)},
    "DtypeObservation": {"dtype": np.float32, "refused": ("SAME_STEP",)},
}


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
@pytest.mark.parametrize("name", WRAPPERS)
def test_wrappers_refuse_the_modes_that_the_page_of_adapters_names(name, mode):
    """By a ValueError in Gymnasium 1.4, by an AssertionError in 1.2."""
    arguments = dict(WRAPPERS[name])
    refused = mode in arguments.pop("refused", ())
    envs = StepperVectorEnv("Hopper", 2, autoreset_mode=mode)
    if not refused:
        getattr(vector, name)(envs, **arguments).reset(seed=0)
        return
    with pytest.raises((ValueError, AssertionError)):
        getattr(vector, name)(envs, **arguments)
