"""Stable-Baselines3: the bits of its own vector environment, its checker, its wrappers, and PPO that learns."""

import csv

import gymnasium
import numpy as np
import pytest
import stepper.envs  # names for Gymnasium
import train_sb3
from checks import every, raises
from envs.test_hooks import Grouped
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecCheckNan, VecFrameStack, VecMonitor, VecNormalize
from stepper.adapters.sb3 import StepperVecEnv
from stepper.envs import StepperVectorEnv
from stepper.policies import evaluate, load

NUM_ENVS = 5


def same(found, expected):
    """Asserts that two infos are the same, bit for bit."""
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        np.testing.assert_array_equal(found[key], value, err_msg=key)


def pair(name, limit, **settings):
    """Ours, and Stable-Baselines3's own of single environments."""

    def one():
        return Monitor(gymnasium.make(f"stepper/{name}-v5", max_episode_steps=limit, disable_env_checker=True, **settings))

    return StepperVecEnv(f"stepper/{name}-v5", NUM_ENVS, max_episode_steps=limit, **settings), DummyVecEnv([one] * NUM_ENVS)


@every(name=["Hopper", "Ant", "HalfCheetah", "Reacher"], precision=["f64", "f32"])
def test_it_says_what_their_own_says_of_single_environments(name, precision):
    ours, theirs = pair(name, 11, precision=precision)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    for envs in (ours, theirs):
        envs.seed(7)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for found, expected in zip(ours.reset_infos, theirs.reset_infos, strict=True):
        same(found, expected)
    draws, ended = np.random.default_rng(0), 0
    for _ in range(40):
        action = draws.uniform(-1, 1, (NUM_ENVS, *ours.action_space.shape)).astype(np.float32)
        found, expected = ours.step(action), theirs.step(action)
        for one, other in zip(found[:3], expected[:3], strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        for one, other, over in zip(found[3], expected[3], found[2], strict=True):
            episode, other_episode = one.pop("episode", None), other.pop("episode", None)
            assert (episode is not None) == (other_episode is not None) == over
            if over:
                ended += 1
                assert episode["l"] == other_episode["l"]
                assert episode["r"] == pytest.approx(other_episode["r"], abs=1e-6)  # Theirs is rounded to six places.
            same(one, other)
        for one, other in zip(ours.reset_infos, theirs.reset_infos, strict=True):
            same(one, other)
    assert ended >= 15


@pytest.mark.filterwarnings("ignore::UserWarning")  # What it recommends of spaces.
@pytest.mark.parametrize("name", sorted(stepper.envs.TASKS))
def test_their_checker_accepts_a_single_environment(name):
    check_env(gymnasium.make(f"stepper/{name}-v5", disable_env_checker=True))


def test_infos_of_ended_episodes_alone():
    ours, every = (StepperVecEnv("stepper/Hopper-v5", NUM_ENVS, max_episode_steps=6, infos=which) for which in ("ended", "all"))
    for envs in (ours, every):
        envs.seed(1)
        envs.reset()
    for _ in range(14):
        _, _, over, infos = ours.step(np.zeros((NUM_ENVS, 3)))
        for info, other, ended in zip(infos, every.step(np.zeros((NUM_ENVS, 3)))[3], over, strict=True):
            if ended:
                info["episode"]["t"] = other["episode"]["t"]
                same(info, other)
            else:
                assert info == {}
    assert over.sum() < NUM_ENVS


def test_their_wrappers_take_it():
    made = StepperVecEnv("stepper/Hopper-v5", NUM_ENVS, max_episode_steps=6, episode_statistics=False)
    envs = VecFrameStack(VecNormalize(VecCheckNan(VecMonitor(made), raise_exception=True)), n_stack=2)
    assert envs.reset().shape == (NUM_ENVS, 22)
    episodes = []
    for _ in range(13):
        _, _, _, infos = envs.step(np.zeros((NUM_ENVS, 3)))
        episodes += [info["episode"]["l"] for info in infos if "episode" in info]
    assert episodes == [6] * 10
    assert made.env_is_wrapped(Monitor) == [False] * NUM_ENVS


def test_calls_that_a_batch_has_no_answer_to_are_named():
    envs = StepperVecEnv("stepper/Hopper-v5", 3)
    assert envs.get_attr("dt", [0, 2]) == [0.008] * 2
    assert envs.get_attr("sim")[0] is envs.envs.sim
    assert not envs.has_attr("no_such_attribute")
    envs.set_attr("label", "hopper")
    assert envs.envs.label == "hopper"
    qpos = np.tile(envs.envs.sim.model.qpos0, (3, 1))
    assert envs.env_method("set_state", qpos, np.zeros((3, 6)))[2].shape == (3, 11)
    raises(ValueError, "omit indices", envs.env_method, "set_state", qpos, np.zeros((3, 6)), indices=[0])
    raises(RuntimeError, "step_async", envs.step_wait)
    envs.set_options({"mass": 2})
    raises(ValueError, "have no options", envs.reset)
    raises(ValueError, '"all" or "ended"', StepperVecEnv, "stepper/Hopper-v5", 3, infos="none")


def test_pictures_are_those_of_the_environments(monkeypatch):
    assert StepperVecEnv("stepper/Hopper-v5", 3).get_images() == [None] * 3
    envs = StepperVecEnv("stepper/Hopper-v5", 4, render_mode="rgb_array")
    drawn = tuple(np.full((2, 3, 3), k, dtype=np.uint8) for k in range(4))
    monkeypatch.setattr(envs.envs, "render", lambda: drawn)  # What it draws is tested where there is a renderer: tests/viewer.
    for found, expected in zip(envs.get_images(), drawn, strict=True):
        np.testing.assert_array_equal(found, expected)
    tiled = envs.render()
    np.testing.assert_array_equal(tiled[:, :, 0], np.kron([[0, 1], [2, 3]], np.ones((2, 3))))


def test_ppo_learns_to_balance_a_pole(tmp_path):
    """The registry's threshold is 950 of 1,000; random actions keep the pole up for some ten steps."""
    envs = StepperVecEnv("stepper/InvertedPendulum-v5", 32, infos="ended", precision="f32")
    learner = PPO("MlpPolicy", envs, n_steps=64, batch_size=256, learning_rate=1e-3, gamma=0.98, ent_coef=0.0, seed=0, device="cpu")
    before, _ = evaluate_policy(learner, StepperVecEnv("stepper/InvertedPendulum-v5", 8), n_eval_episodes=8, deterministic=True)
    learner.learn(80_000)
    assert learner.ep_info_buffer[-1]["r"] > 100
    learner.save(tmp_path / "ppo")
    again = PPO.load(tmp_path / "ppo", device="cpu")
    after, _ = evaluate_policy(again, StepperVecEnv("stepper/InvertedPendulum-v5", 8), n_eval_episodes=8, deterministic=True)
    assert before < 100
    assert after > 900


def test_learners_with_a_replay_buffer_take_it():
    envs = StepperVecEnv("stepper/Hopper-v5", 4, max_episode_steps=20, dtype="float32")
    SAC("MlpPolicy", envs, learning_starts=50, batch_size=16, seed=0, device="cpu").learn(200)


def test_a_seed_of_the_constructor_is_that_of_seed():
    name = "stepper/Hopper-v5"
    first, second, other = StepperVecEnv(name, 3, seed=7), StepperVecEnv(name, 3), StepperVecEnv(name, 3, seed=8)
    second.seed(7)
    np.testing.assert_array_equal(first.reset(), second.reset())
    assert (first.reset() != other.reset()).any()


def test_names_of_make_vec_env_and_another_mode_are_named():
    raises(TypeError, "takes no 'n_envs'; did you mean num_envs", StepperVecEnv, "stepper/Hopper-v5", n_envs=3)
    with pytest.raises(TypeError, match=r"the task is a value of type TimeLimit, must be .* the name of one"):
        StepperVecEnv(gymnasium.make("stepper/Hopper-v5"))
    with pytest.raises(ValueError, match="autoreset_mode is NEXT_STEP, must be SAME_STEP for Stable-Baselines3: leave it out"):
        StepperVecEnv("stepper/Hopper-v5", autoreset_mode="NEXT_STEP")


def test_observation_groups_are_a_dictionary():
    """Observations and final observations equal those of the vector environment, and PPO learns from both groups."""
    ours = StepperVecEnv(Grouped(), 3, seed=0, max_episode_steps=4, groups=True)
    envs = StepperVectorEnv(Grouped(), 3, max_episode_steps=4, groups=True, autoreset_mode="SAME_STEP")
    found, (expected, _) = ours.reset(), envs.reset(seed=0)
    for _ in range(8):
        same(found, expected)
        found, _, over, infos = ours.step(np.full((3, 1), 0.5))
        expected, *_, theirs = envs.step(np.full((3, 1), 0.5))
        for k in np.flatnonzero(over):
            same(infos[k]["terminal_observation"], theirs["final_obs"][k])
    PPO("MultiInputPolicy", ours, n_steps=8, batch_size=12, n_epochs=1, device="cpu").learn(24)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sb3")
    return train_sb3.train("stepper/InvertedPendulum-v5", folder, steps=120_000, num_envs=64, precision="f32"), folder


def test_it_learns(run):
    """To balance a pole, from some 6 to hundreds of 1000 actions."""
    with (run[1] / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["return"]) > 5.0 * float(rows[0]["return"])
    assert [int(row["steps"]) for row in rows] == [64 * 64 * (k + 1) for k in range(len(rows))]


def test_the_policy_that_is_kept_acts_alike(run):
    model, folder = run
    policy = load(folder / "policy.npz")
    envs = model.get_env()
    observation = envs.obs_rms.mean + 30.0 * np.random.default_rng(0).normal(size=(50, 4))
    expected, _ = model.predict(envs.normalize_obs(observation.astype(np.float32)), deterministic=True)
    np.testing.assert_allclose(policy(observation), expected, atol=1e-4)
    # The pendulum's actions have bounds of 3, to which a policy stretches what lies within -1 and 1.
    assert np.abs(expected).max() > 1.5


def test_both_evaluate_alike(run):
    model, folder = run
    theirs = train_sb3.evaluate(model, "stepper/InvertedPendulum-v5", episodes=10, precision="f32")
    ours = evaluate(load(folder / "policy.npz"), "stepper/InvertedPendulum-v5", episodes=10, seed=train_sb3.FRESH, precision="f32")
    assert np.mean(theirs) == pytest.approx(ours.mean, rel=0.2)
    assert load(folder / "policy.npz").environment["engine"] == "stepper"
