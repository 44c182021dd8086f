"""Observation groups: errors, delays and histories of rows, and what environments and learners get of several groups."""

from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import stepper
from envs.cases import SLIDE, Slide, same
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stepper.envs import Group, Observation, StepperEnv, StepperVectorEnv, normal, scale, uniform
from stepper.envs.commands import VelocityCommand

MODEL = stepper.load(SLIDE)


def position(now):
    return now.qpos


@dataclass(frozen=True, kw_only=True)
class Grouped(Slide):
    """A slider whose policy sees errors, and whose critic does not."""

    commands = {"twist": VelocityCommand(every=(0.004, 0.01), x=(-1.0, 1.0))}  # noqa: RUF012

    def model(self):
        return MODEL

    def observations(self):
        policy = (
            Observation(position, noise=normal(0.0, 0.1), bias=0.2, history=3, delay=(0, 2)),
            Observation("qvel", noise=0.1, clip=(-0.05, 0.05), scale=2.0, delay=1),
            Observation("twist"),
            Observation("action"),
        )
        return {"policy": policy, "critic": Group(policy, noise=False, extra=(Observation("body_mass[1]"),))}


def made(kind=StepperVectorEnv, **given):
    return kind(Grouped(), **({"max_episode_steps": 6} | given))


def only(*rows):
    """A slider with these rows."""

    class Only(Slide):
        def model(self):
            return MODEL

        def observations(self):
            return rows

    return Only()


def seen(task, steps=6, num_envs=3, **given):
    """Observations of an environment after reset and after each step with the action 0.5, (steps + 1, num_envs, n)."""
    envs = StepperVectorEnv(task, num_envs, **given)
    return np.array([envs.reset(seed=0)[0], *(envs.step(np.full((num_envs, 1), 0.5))[0] for _ in range(steps))])


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_batch_of_groups_has_the_bits_of_single_environments(mode):
    """Observations, final observations and infos equal those of single environments, because each draws from one stream."""
    envs = made(num_envs=3, groups=True, autoreset_mode=mode)
    alone = SyncVectorEnv([lambda: made(StepperEnv, groups=True)] * 3, autoreset_mode=mode)
    same(envs.reset(seed=3), alone.reset(seed=3))
    rng = np.random.default_rng(0)
    for k in range(6 if mode == AutoresetMode.DISABLED else 15):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        ours, theirs = envs.step(actions), alone.step(actions)
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            same(one, other)
        assert ("final_obs" in ours[4]) == (mode == AutoresetMode.SAME_STEP and k % 6 == 5)
        if "final_obs" in ours[4]:
            same(ours[4]["final_obs"], theirs[4]["final_obs"])
    assert envs.observation_structure["critic"] == {"position": 3, "qvel": 1, "twist": 3, "action": 1, "body_mass[1]": 1}
    assert isinstance(envs.single_observation_space, gymnasium.spaces.Dict)
    assert ours[0] in envs.observation_space


def test_without_groups_the_observation_is_that_of_the_policy():
    """The array equals the group "policy" bit for bit, because errors do not depend on which groups are computed."""
    grouped, flat = made(num_envs=4, groups=True), made(num_envs=4)
    np.testing.assert_array_equal(grouped.reset(seed=1)[0]["policy"], flat.reset(seed=1)[0])
    for k in range(9):
        actions = np.full((4, 1), 0.1 * k)
        np.testing.assert_array_equal(grouped.step(actions)[0]["policy"], flat.step(actions)[0])
    assert list(flat.observation_structure) == ["position", "qvel", "twist", "action"]


def test_the_critic_sees_no_errors():
    envs = made(num_envs=2, groups=True)
    observation, _ = envs.reset(seed=1)
    for _ in range(3):
        observation = envs.step(np.ones((2, 1)))[0]
    critic, now = observation["critic"], envs.now
    np.testing.assert_array_equal(critic[:, 2], now.qpos[:, 0])  # the newest of three positions
    np.testing.assert_array_equal(critic[:, 3], np.clip(now.qvel[:, 0], -0.05, 0.05) * 2.0)
    np.testing.assert_array_equal(critic[:, 4:7], now.command("twist"))
    np.testing.assert_array_equal(critic[:, 8], now.parameter("body_mass[1]")[:, 0])
    assert not np.array_equal(observation["policy"][:, 2], now.qpos[:, 0])


def test_a_history_has_the_last_observations_the_oldest_first():
    true, found = seen(only(Observation("qpos"))), seen(only(Observation("qpos", history=3)))
    for k in range(7):
        expected = true[[max(0, k - 2), max(0, k - 1), k], :, 0].T
        np.testing.assert_array_equal(found[k], expected)


def test_a_delay_shows_earlier_observations():
    true = seen(only(Observation("qpos")))
    np.testing.assert_array_equal(seen(only(Observation("qpos", delay=2)))[2:], true[:-2])
    np.testing.assert_array_equal(seen(only(Observation("qpos", delay=2)))[:2], true[[0, 0]])
    drawn = seen(only(Observation("qpos", delay=(1, 3))), num_envs=64)
    true = seen(only(Observation("qpos")), num_envs=64)
    # Positions of the accelerated slider differ between steps, so that a position tells its step.
    delays = [next(d for d in range(4) if drawn[6, env, 0] == true[6 - d, env, 0]) for env in range(64)]
    assert set(delays) == {1, 2, 3}


def test_noise_and_bias_have_their_distributions():
    """Means and deviations equal those of the distributions within 5 standard errors, a chance of 6e-7 each."""
    n = 4000
    for error, mean, std in ((0.3, 0.0, 0.3 / 3**0.5), (normal(0.1, 0.2), 0.1, 0.2), (uniform(0.0, 1.0), 0.5, 1 / 12**0.5)):
        values = seen(only(Observation("qpos", noise=error), Observation("start", func=position, bias=error)), steps=1, num_envs=n)
        true = seen(only(Observation("qpos")), steps=1, num_envs=n)
        noise, bias = (values - true).transpose(2, 0, 1)
        np.testing.assert_array_equal(np.round(bias[0], 9), np.round(bias[1], 9))
        assert not np.allclose(noise[0], noise[1])
        for errors in (noise[1], bias[1]):
            assert abs(errors.mean() - mean) < 5 * std / n**0.5
            assert abs(errors.std() - std) < 5 * std / n**0.5  # the error of a deviation is at most std / sqrt(n) for these distributions
    one = seen(only(Observation("ones", func=lambda now: np.ones((len(now.qpos), 1)), noise=scale(0.5, 2.0))), num_envs=n)
    assert 0.5 <= one.min() < 0.51
    assert 1.99 < one.max() <= 2.0


def test_a_position_that_the_user_sets_is_observed_once():
    envs = StepperVectorEnv(only(Observation("qpos", history=2)), 1)
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.set_state(qpos=[[0.5]]), [[0.5, 0.5]])
    envs.step(np.zeros((1, 1)))
    np.testing.assert_array_equal(envs.set_state(qpos=[[0.7]]), [[0.5, 0.7]])
