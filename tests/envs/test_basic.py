"""Basics of tasks: the falling block and the grasp, seeds, draws of `Rng`, and finite observations and rewards."""

import copy
import pickle
from dataclasses import dataclass

import falling_block
import gymnasium
import numpy as np
import pytest
import stepper.envs
from checks import raises
from envs.cases import Strong, same
from gymnasium.vector import AutoresetMode
from hypothesis import given, strategies as st
from stepper.envs import Observation, Rng, StepperEnv, StepperVectorEnv, normal, seeds
from stepper.envs.basic import FallingBlock, Grasp
from stepper.envs.basic.grasp import FORCE, FRICTION, GRAVITY, MASS, OPTIONS
from stepper.shared.streams import Streams

NAMES = ["stepper/FallingBlock-v0", "stepper/Grasp-v0"]


def test_it_is_the_textbooks_recursion():
    envs = gymnasium.make_vec(NAMES[0], num_envs=6)
    _, info = envs.reset(seed=1)
    e, h, v = info["restitution"], np.full(6, 0.20), np.full(6, -0.10)
    assert len(np.unique(e)) == 6
    for _ in range(50):
        observation, reward, *_ = envs.step(np.zeros((6, 1)))
        v = v - 9.81 * 0.02
        h = h + v * 0.02
        v, h = np.where(h < 0, -e * v, v), np.where(h < 0, 0.0, h)
        np.testing.assert_allclose(observation, np.stack([h, v], axis=1), atol=1e-12)
        np.testing.assert_array_equal(reward, h > 0.05)


def test_the_example_that_writes_it_out_says_the_same():
    own, theirs = StepperVectorEnv(FallingBlock(restitution=(0.3, 0.3)), 2, options=falling_block.OPTIONS), falling_block.FallingBlocks(2)
    theirs.reset(seed=0)
    theirs._restitution[:, 1] = 0.3
    theirs._sim.randomize(geom_restitution=theirs._restitution)
    own.reset(seed=0)
    for action in np.random.default_rng(2).uniform(-1, 1, (30, 2, 1)):
        same(own.step(action)[:3], theirs.step(action)[:3])


def test_sensors_may_be_noisy_and_rewards_are_of_the_truth():
    envs = gymnasium.make_vec(NAMES[0], num_envs=400, noise=0.5)
    observation, info = envs.reset(seed=0)
    assert observation[:, 0].std() == pytest.approx(0.5, rel=0.2)
    observation, reward, *_, info = envs.step(np.zeros((400, 1)))
    assert (reward == 1.0).all()
    assert (observation[:, 0] < 0.0).any()
    assert (info["height"] > 0.05).all()


def squeezed(force, **settings):
    """How high the box is at the end of an episode in which the fingers press with a force, N."""
    task = Grasp(**settings)
    envs = StepperVectorEnv(task, 32, options=OPTIONS, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=0)
    for k in range(50):
        lift = 0.0 if k < 10 else 0.3
        *_, info = envs.step(np.tile([lift, force / FORCE, force / FORCE], (32, 1)))
    return info["rise"]


def test_a_box_is_held_where_friction_allows_it():
    least = MASS * GRAVITY / (2.0 * FRICTION)
    assert (squeezed(1.25 * least) > 0.02).all()
    assert (squeezed(0.8 * least) < 0.001).all()
    # With friction of its own, of an interval about what the force needs, some hold and some do not.
    assert 0 < (squeezed(1.1 * least, friction=(0.4, 0.8)) > 0.02).sum() < 32
    assert 0 < (squeezed(0.8 * least, mass_scale=(0.4, 1.1)) > 0.02).sum() < 32


@given(st.integers(0, 2**70), st.integers(0, 40), st.integers(0, 40))
def test_a_longer_list_begins_with_the_shorter_one(run, few, more):
    assert seeds(run, few + more)[:few] == seeds(run, few)
    assert all(0 <= seed < 2**64 for seed in seeds(run, more))


def test_runs_share_no_seed():
    """Of a million seeds of 1,000 runs, two are equal with a chance of 3e-8: 1e12 pairs over 2^64 seeds, halved."""
    drawn = [seed for run in range(1000) for seed in seeds(run, 1000)]
    assert len(set(drawn)) == len(drawn)
    assert seeds((3, 0), 5) != seeds((3, 1), 5)


def test_spread_runs_share_no_start_and_gymnasiums_share_nearly_all():
    def starts(seed):
        envs = StepperVectorEnv("HalfCheetah", 32)
        return {tuple(row) for row in envs.reset(seed=seed)[0].tolist()}

    assert len(starts(0) & starts(1)) == 31
    assert not starts(seeds(0, 32)) & starts(seeds(1, 32))


@pytest.mark.parametrize(
    ("run", "num_envs", "text"), [(-1, 3, "the seed of a run is -1"), (1.5, 3, "1.5"), ((1, "a"), 3, "'a'"), (1, -1, "num_envs")]
)
def test_wrong_seeds_are_named(run, num_envs, text):
    raises((TypeError, ValueError), text, stepper.envs.seeds, run, num_envs)


def generator(num_envs=3):
    return Rng(Streams(num_envs, 5), np.arange(num_envs))


@given(st.integers(1, 5), st.lists(st.integers(0, 4), max_size=3).map(tuple))
def test_a_tuple_gives_the_numbers_of_its_product(num_envs, shape):
    size = int(np.prod(shape, dtype=int))
    for draw in (lambda rng, size: rng.uniform(-2.0, 3.0, size), lambda rng, size: rng.normal(size)):
        one, other = generator(num_envs), generator(num_envs)
        found = draw(one, shape)
        assert found.shape == (num_envs, *shape)
        np.testing.assert_array_equal(found.reshape(num_envs, size), draw(other, size))
        np.testing.assert_array_equal(one._streams.state, other._streams.state)


@given(st.floats() | st.text() | st.none() | st.tuples(st.floats()))
def test_another_size_is_an_error(size):
    for draw in (lambda: generator().uniform(0.0, 1.0, size), lambda: generator().normal(size)):
        raises(TypeError, r"^size is .*, must be a whole number or a tuple of them", draw)


@given(st.integers(max_value=-1))
def test_a_negative_size_is_an_error(size):
    raises(ValueError, r"^size is \(3, -\d+\), must be at least 0", lambda: generator().normal((3, size)))


def test_generators_are_copied():
    for twin in (copy.deepcopy(generator()), pickle.loads(pickle.dumps(generator()))):
        np.testing.assert_array_equal(twin.normal(2), generator().normal(2))


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Observation("qvel", "qpos"), "func of Observation 'qvel' is 'qpos', must be a function of now, or None"),
    *((lambda clip=clip: Observation("qvel", clip=clip), "must be the lower bound and then the upper bound") for clip in (5.0, (1.0,))),
    (lambda: Observation("qpos", clip=(1, -1)), "clip of Observation 'qpos' is (1, -1), must be the lower bound and then the upper bound"),
    (lambda: Observation("qvel", noise=-1.0), "noise of Observation 'qvel' is -1.0, must be a finite number of at least 0"),
    (lambda: Observation("qvel", noise=(-1.0, 1.0)), "noise of Observation 'qvel' is (-1.0, 1.0), must be a number"),
    (lambda: Observation("qpos", delay=(2, 1)), "delay of Observation 'qpos' is (2, 1), must be a whole number or a tuple of two"),
    (lambda: Observation("qpos", history=0), "history of Observation 'qpos' is 0"),
    (lambda: Observation("speed", lambda: 0), "func of Observation 'speed' is <lambda>(), must take 1 argument, now: write lambda now"),
    (lambda: Observation(3), "the name of an Observation is 3, must be a text: Observation(name, func=...)"),
    (lambda: normal(0.0, -1.0), "the latter at least 0"),
])  # fmt: skip
def test_wrong_rows_are_errors(make, message):
    with pytest.raises((TypeError, ValueError)) as error:
        make()
    assert message in str(error.value)


def test_wrenches_of_contacts_carry_the_robot():
    """What lies still is carried: forces add to the weight, and torques about the centre of mass to none."""
    envs = StepperVectorEnv("Ant", 3, contact="hard", terminate_when_unhealthy=False)
    envs.reset(seed=0)
    assert not envs.now.cfrc_ext.any()
    for _ in range(200):
        envs.step(np.zeros((3, 8)))
    total = envs.now.cfrc_ext.sum(axis=1)
    weight = 9.81 * envs.sim.model.body_mass.sum()
    np.testing.assert_allclose(total[:, 3:], [[0.0, 0.0, weight]] * 3, atol=0.02 * weight)
    # An arm of 0.1 m is some tenth of the robot.
    np.testing.assert_allclose(total[:, :3], 0.0, atol=0.02 * weight * 0.1)


# Observations and rewards are finite: for actions that are not, for states that would not be, and for rewards of tasks that are not.


@dataclass(frozen=True, kw_only=True)
class Logarithm(Strong):
    """A reward that is NaN or infinite for some positions."""

    def reward(self, now):
        with np.errstate(all="ignore"):
            return np.log(now.action[:, 0]), {}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_is_refused_and_nothing_is_stepped(bad):
    envs, env = StepperVectorEnv("HalfCheetah", 3), StepperEnv("HalfCheetah")
    envs.reset(seed=0), env.reset(seed=0)
    before, action = envs.sim.get_state(), np.zeros((3, 6))
    action[1:, 4] = bad
    raises(ValueError, rf"environment 1 is {bad} in column 4 \(2 of 3 environments", envs.step, action)
    assert envs.sim.get_state() == before
    assert not envs.episode_lengths.any()
    raises(ValueError, rf"environment 0 is {bad} in column 4", env.step, action[1])
    envs.step(np.zeros((3, 6)))


def test_actions_that_environments_ignore_may_be_anything():
    envs = StepperVectorEnv("HalfCheetah", 2, max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 6)))
    observation, reward, *_ = envs.step(np.full((2, 6), np.nan))
    assert np.isfinite(observation).all()
    assert not reward.any()
    assert not envs.now.action.any()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_an_environment_whose_state_would_not_be_finite_is_terminated(mode):
    envs = StepperVectorEnv(Strong(), 3, autoreset_mode=mode)
    envs.reset(seed=0)
    failing = np.array([False, True, False])
    observation, reward, terminated, _, info = envs.step(np.where(failing, 1e250, 0.0)[:, None])
    np.testing.assert_array_equal(terminated, failing)
    np.testing.assert_array_equal((info["final_info"] if mode == "SameStep" else info)["non_finite"], failing)
    assert np.isfinite(observation).all()
    np.testing.assert_array_equal(reward, [1.0, 0.0, 1.0])
    if mode == "Disabled":
        envs.reset(options={"reset_mask": failing})
    *_, terminated, _, info = envs.step(np.zeros((3, 1)))
    assert not terminated.any()
    assert "non_finite" not in info


def test_a_reward_that_is_not_finite_names_its_environment():
    envs = StepperVectorEnv(Logarithm(), 3)
    envs.reset(seed=0)
    said = r"reward of environment 1 is nan after the action \[-1\.0\]: return finite numbers from Logarithm\.reward"
    raises(ValueError, said, envs.step, np.array([[1.0], [-1.0], [1.0]]))
    _, reward, *_ = envs.step(np.ones((3, 1)))
    assert not reward.any()
