"""Returns, confidence intervals and equivalence of a policy."""

from dataclasses import dataclass
from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest
import stepper.envs
from checks import raises
from envs.cases import Strong, needs_gymnasiums
from scipy import stats
from stepper.envs.tasks import InvertedPendulum
from stepper.policies import Comparison, Evaluation, compare, evaluate, make
from stepper.policies.evaluation import _starts
from stepper.shared import machine


def still(observation):
    return np.zeros((len(observation), 1))


def push(observation):
    return np.clip(observation @ np.array([[0.3], [4.0], [0.5], [0.8]]), -3.0, 3.0)


def test_returns_are_those_of_single_episodes():
    """Of an environment whose episodes end at different times."""
    found = evaluate(still, "stepper/InvertedPendulum-v5", episodes=6, seed=3)
    for k, seed in enumerate(stepper.envs.seeds(3, 6)):
        env = gymnasium.make("stepper/InvertedPendulum-v5")
        env.reset(seed=seed)
        total, length, over = 0.0, 0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(np.zeros(1))
            total, length, over = total + reward, length + 1, terminated or truncated
        assert (found.returns[k], found.lengths[k]) == (total, length)
    assert len(set(found.lengths)) > 1


def test_infos_are_means_over_each_episode():
    """The cheetah's velocity, of episodes whose time runs out; the pendulum's distance, of episodes that end at different times."""
    found = evaluate(lambda observation: np.full((len(observation), 6), 0.3), "stepper/HalfCheetah-v5", episodes=2, infos=("x_velocity",))
    single = gymnasium.make("stepper/HalfCheetah-v5")
    single.reset(seed=stepper.envs.seeds(0, 2)[1])
    velocities = [single.step(np.full(6, 0.3))[4]["x_velocity"] for _ in range(1000)]
    # The same numbers summed in the same order.
    assert found.infos["x_velocity"][1] == np.cumsum(velocities)[-1] / 1000
    assert f"x_velocity {found.infos['x_velocity'].mean():.4g}" in str(found)
    assert found.final_infos["x_velocity"][1] == velocities[-1]
    assert f", at the end {found.final_infos['x_velocity'].mean():.4g}" in str(found)
    falls = evaluate(still, "stepper/InvertedDoublePendulum-v5", episodes=6, infos=("reward_survive",))
    assert len(set(falls.lengths)) > 1
    # It is 10 in every step but the last, in which it falls.
    np.testing.assert_allclose(falls.infos["reward_survive"], 10.0 * (1.0 - 1.0 / falls.lengths), rtol=1e-12)


def test_the_end_of_a_running_sum_is_the_sum_of_the_episode():
    """A task that sums over its episodes has its sum in the last info; the mean over the steps of an episode is another number."""
    found = evaluate(still, "stepper/InvertedPendulum-v5", episodes=6, infos=("reward_survive",))
    assert len(set(found.lengths)) > 1

    @dataclass(frozen=True, kw_only=True)
    class Summed(InvertedPendulum):
        def episode_state(self, num_envs):
            return {"sum": np.zeros(num_envs)}

        def reward(self, now):
            rewards, terms = super().reward(now)
            now.episode_state["sum"] += rewards
            return rewards, terms | {"sum": np.array(now.episode_state["sum"])}

    gymnasium.register("me/Summed-v0", vector_entry_point="stepper.envs:StepperVectorEnv", kwargs={"task": Summed}, max_episode_steps=1000)
    try:
        sums = evaluate(still, "me/Summed-v0", episodes=6, infos=("sum",))
    finally:
        del gymnasium.registry["me/Summed-v0"]
    np.testing.assert_array_equal(sums.returns, found.returns)
    np.testing.assert_array_equal(sums.final_infos["sum"], sums.returns)
    assert (sums.infos["sum"] != sums.returns).any()


def test_evaluations_with_other_seeds_share_no_episode():
    """With seed + k as the seed of episode k, seeds 0 and 1 would share five of six."""
    one, other = (evaluate(still, "stepper/InvertedPendulum-v5", episodes=6, seed=seed) for seed in (0, 1))
    assert not np.array_equal(one.returns[1:], other.returns[:-1])
    starts = [_starts("stepper/InvertedPendulum-v5", 6, seed, {})[0] for seed in (0, 1)]
    assert not {tuple(row) for row in starts[0]} & {tuple(row) for row in starts[1]}


def test_an_info_that_there_is_not_is_named():
    with pytest.raises(ValueError, match=r"there is no info 'speed' with one number per environment; such infos are: .*reward_survive"):
        evaluate(still, "stepper/InvertedDoublePendulum-v5", episodes=2, infos=("speed",))


@needs_gymnasiums
def test_gymnasiums_own_environment_from_the_same_starts():
    """Under MuJoCo's law, and its solver: it balances in both for as long, to the bound of an episode."""
    both = compare(push, "InvertedPendulum-v5", "stepper/InvertedPendulum-v5", episodes=3)
    assert (both.one.returns == 1000).all()
    assert (both.other.returns == 1000).all()
    falls = compare(still, "stepper/InvertedPendulum-v5", "InvertedPendulum-v5", episodes=8, seed=1)
    # The same starts fall after as many actions; other starts do not.
    np.testing.assert_array_equal(falls.one.lengths, falls.other.lengths)
    assert (evaluate(still, "InvertedPendulum-v5", episodes=8, seed=1).lengths != falls.one.lengths).any()


def evaluated(returns):
    return Evaluation(env="some", returns=np.asarray(returns, dtype=float), lengths=np.ones(len(returns), dtype=int))


def test_intervals_are_students():
    values = np.random.default_rng(0).normal(100.0, 5.0, 12)
    low, high = evaluated(values).interval(0.95)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    np.testing.assert_allclose([low, high], [expected.low, expected.high], rtol=1e-12)
    assert f"95 % confidence {low:.1f} to {high:.1f}" in str(evaluated(values))


def test_equivalence_is_two_one_sided_tests():
    rng = np.random.default_rng(1)
    verdicts = set()
    for shift in (0.0, 1.0, 1.9, 2.1, 5.0, -5.0):
        one = evaluated(100.0 + rng.normal(0.0, 20.0, 40))
        other = evaluated(one.returns + rng.normal(0.0, 2.0, 40) + shift)
        both = Comparison(one=one, other=other)
        paired = other.returns - one.returns
        above = stats.ttest_1samp(paired, -both.bound, alternative="greater").pvalue
        below = stats.ttest_1samp(paired, both.bound, alternative="less").pvalue
        assert (both.verdict == "equivalent") == (max(above, below) < 0.05)
        verdicts.add(both.verdict)
    assert verdicts == {"equivalent", "open", "different"}


def test_environments_at_the_margin_are_called_equivalent_in_one_case_of_twenty():
    rng = np.random.default_rng(2)
    count = 0
    for _ in range(2000):
        one = evaluated(np.full(30, 100.0))
        count += Comparison(one=one, other=evaluated(102.0 + rng.normal(0.0, 1.0, 30))).verdict == "equivalent"
    # Binomial with 2,000 draws of 0.05: 100 with a deviation of 10.
    assert 60 < count < 140


def test_episodes_that_fail_are_said():
    if "test/Strong-v0" not in gymnasium.registry:
        vector = {"vector_entry_point": "stepper.envs:StepperVectorEnv", "max_episode_steps": 3, "kwargs": {"task": Strong}}
        gymnasium.register("test/Strong-v0", entry_point="stepper.envs:StepperEnv", **vector)
    found = evaluate(lambda observation: np.full((len(observation), 1), 1e250), "test/Strong-v0", episodes=2)
    assert found.non_finite == 2
    assert "2 ended because their next state would not have been finite" in str(found)


def test_a_policy_whose_actions_are_nan_is_an_error():
    with pytest.raises(ValueError, match="action of environment 0 is nan in column 0 \(2 of 2 environments"):
        evaluate(lambda observation: np.full((len(observation), 1), np.nan), "stepper/InvertedPendulum-v5", episodes=2)


@pytest.mark.parametrize(("arguments", "message"), [
    (("stepper/InvertedPendulum-v5", {"episodes": 1}), "episodes is 1"),
    (("stepper/InvertedPendulum-v6", {}), "v6"),
    (("stepper/Nothing-v0", {}), "Nothing"),
])  # fmt: skip
def test_what_cannot_be_evaluated_is_an_error(arguments, message):
    env, settings = arguments
    raises(ValueError, message, evaluate, still, env, **settings)


def test_starts_are_of_a_stepper():
    raises(ValueError, "one must be on stepper", compare, still, "InvertedPendulum-v5", "InvertedPendulum-v4")


def test_starts_are_those_of_the_seeds():
    both = compare(still, "stepper/InvertedPendulum-v5", "stepper/InvertedPendulum-v5", episodes=5, seed=4)
    np.testing.assert_array_equal(both.one.returns, both.other.returns)
    np.testing.assert_array_equal(both.one.returns, evaluate(still, "stepper/InvertedPendulum-v5", episodes=5, seed=4).returns)


@pytest.mark.parametrize(
    ("absent", "listed"),
    [({"imageio"}, "imageio is needed"), ({"glfw", "imageio"}, "glfw, imageio are needed"), ({"mujoco"}, "mujoco is needed")],
)
def test_all_missing_packages_of_gymnasiums_environments_are_named_at_once(monkeypatch, absent, listed):
    monkeypatch.setattr(machine.importlib.util, "find_spec", lambda name: None if name in absent else find_spec(name))
    with pytest.raises(machine.MissingPackageError, match=listed) as error:
        make("HalfCheetah-v5")
    assert str(error.value).endswith('not installed: pip install "stepper-sim[envs]"')
