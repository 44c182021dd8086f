"""`stepper train`: a run goes on to the same curve, and its policy acts the same without torch (`make training`)."""

import csv
import dataclasses
import inspect
import warnings

import gymnasium
import numpy as np
import pytest
from checks import raises
from envs.cases import needs_gymnasiums
from stepper.policies import load, make

torch = pytest.importorskip("torch", reason="torch is not installed: make training")
from stepper.policies import ppo as train, ppo_settings  # noqa: E402

SMALL = {"num_envs": 32, "horizon": 16, "minibatch": 256, "threads": 1, "hidden": (16, 16)}
PER_ITERATION = 32 * 16


class StoppedError(Exception):
    pass


def rows_of(folder):
    with (folder / "curve.csv").open() as file:
        return [{name: value for name, value in row.items() if name not in ("seconds", "processor")} for row in csv.DictReader(file)]


@pytest.mark.parametrize("env", ["stepper/InvertedPendulum-v5", "stepper/Reacher-v5"])
def test_a_run_that_was_stopped_goes_on_to_the_same_curve(env, tmp_path, monkeypatch):
    """Episodes that fall, and episodes whose time runs out, begin and end on both sides of the checkpoint."""
    settings = train.Settings(env=env, steps=12 * PER_ITERATION, **SMALL)
    whole = train.train(settings, tmp_path / "whole", quiet=True)
    append = train._append

    def stop(curve, row):
        append(curve, row)
        if row["iteration"] == 8:
            raise StoppedError

    monkeypatch.setattr(train, "_append", stop)
    half = train.train(train.Settings(env=env, steps=5 * PER_ITERATION, **SMALL), tmp_path / "parts", quiet=True)
    assert half.iteration == 5
    with pytest.raises(StoppedError):
        train.train(settings, tmp_path / "parts", quiet=True)
    assert len(rows_of(tmp_path / "parts")) == 8  # Three rows after the checkpoint, which are made again.
    monkeypatch.setattr(train, "_append", append)
    parts = train.train(settings, tmp_path / "parts", quiet=True)
    assert rows_of(tmp_path / "parts") == rows_of(tmp_path / "whole")
    assert len(rows_of(tmp_path / "whole")) == 12
    assert 0 < half.episodes < parts.episodes
    observation = np.random.default_rng(0).normal(size=(7, len(whole.observed["policy"].mean)))
    np.testing.assert_array_equal(parts.policy()(observation), whole.policy()(observation))


def test_the_first_line_says_that_no_episode_has_ended(tmp_path, capsys):
    """Episodes of the Reacher have 50 steps, and the first update sees 16 of each."""
    train.train(train.Settings(env="stepper/Reacher-v5", steps=PER_ITERATION, **SMALL), tmp_path)
    printed = capsys.readouterr().out
    assert "no episode has ended yet" in printed
    assert "nan" not in printed


def test_another_run_in_the_folder_is_an_error(tmp_path):
    settings = {"env": "stepper/Reacher-v5", "steps": PER_ITERATION, **SMALL}
    train.train(train.Settings(**settings), tmp_path, quiet=True)
    with pytest.raises(ValueError, match=r"gamma is 0.99 there, 0.9 here; seed is|seed is 1 there, 2 here; gamma is 0.99 there, 0.9 here"):
        train.train(train.Settings(**settings, gamma=0.9, seed=2), tmp_path, quiet=True)


def test_the_policy_is_the_actor(tmp_path):
    run = train.train(train.Settings(env="stepper/HalfCheetah-v5", steps=PER_ITERATION, **SMALL), tmp_path, quiet=True)
    loaded = load(tmp_path / "policy.npz", env=run.envs)
    observation = np.random.default_rng(0).normal(size=(50, 17)) * 3.0
    with torch.no_grad():
        expected = run.net.actor(run.normal(observation)).numpy()
    # Both in 32 bits, in other orders: some units in the last place of sums of 17 and 16 numbers.
    np.testing.assert_allclose(loaded(observation), np.clip(expected, -1.0, 1.0), atol=1e-6)


def test_moments_are_those_of_all_rows():
    rows = np.random.default_rng(0).normal(3.0, 2.0, (1000, 4))
    moments = train.Moments(4)
    for part in np.array_split(rows, 7):
        moments.update(part)
    # It begins with 1e-4 of a row of mean 0 and variance 1.
    np.testing.assert_allclose(moments.mean, rows.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(moments.var, rows.var(axis=0), rtol=1e-6)


def test_every_setting_is_an_option_with_its_help(monkeypatch):
    """With the docstring as Python before 3.13 has it, and as later ones do."""
    for text in (train.Settings.__doc__, inspect.cleandoc(train.Settings.__doc__)):
        monkeypatch.setattr(train.Settings, "__doc__", text)
        parser = train.arguments()
        helps = {action.dest: action.help for action in parser._actions}
        for field in dataclasses.fields(train.Settings):
            assert len(helps[field.name]) > 10
        assert f"[{train.Settings.minibatch}]" in parser.format_help()


def test_a_task_has_settings_of_its_own_and_options_go_before_them(monkeypatch):
    own = ppo_settings.TASKS["Hopper-v5"]["num_envs"]
    assert own != train.Settings.num_envs
    for env in ("Hopper-v5", "stepper/Hopper-v5"):
        assert train.Settings.of_task(env).num_envs == own
        assert train.Settings.of_task(env, num_envs=512).num_envs == 512
    assert train.Settings.of_task("stepper/HalfCheetah-v5") == train.Settings()
    taken = []
    monkeypatch.setattr(train, "train", lambda settings, folder: taken.append(settings) or (_ for _ in ()).throw(StoppedError))
    monkeypatch.setattr("sys.argv", ["train.py", "Hopper-v5", "--horizon", "128"])
    with pytest.raises(StoppedError):
        train.main()
    assert taken == [train.Settings.of_task("Hopper-v5", horizon=128)]


@pytest.mark.parametrize(("settings", "message"), [
    ({"num_envs": 128}, r"minibatch is 8192, must be from 1 to the 4096 samples.*--minibatch"),
    ({"minibatch": 0}, "minibatch is 0"),
])  # fmt: skip
def test_settings_that_learn_nothing_are_named(settings, message):
    raises(ValueError, message, train.Settings, **settings)


@needs_gymnasiums
def test_it_trains_in_gymnasiums_own_environment_too(tmp_path):
    settings = train.Settings(env="InvertedPendulum-v5", steps=8 * PER_ITERATION, **SMALL)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        run = train.train(settings, tmp_path, quiet=True)
    assert run.episodes > 0
    assert run.policy().environment["engine"] == "MuJoCo"
    again = train.Run.load(tmp_path / "checkpoint.pt")
    assert (again.steps, again.episodes) == (run.steps, run.episodes)
    assert run.discounted.any()
    assert not again.discounted.any()  # Its episodes are new.


def test_it_trains_in_vector_environments_of_others(tmp_path):
    """They are asked for the autoreset themselves; the statistics of episodes are Gymnasium's."""
    name = "others/Pole-v0"
    gymnasium.register(name, vector_entry_point="stepper.envs:StepperVectorEnv", kwargs={"task": "InvertedPendulum"}, max_episode_steps=20)
    try:
        envs = make(name, SMALL["num_envs"], training=True)
        assert envs.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.SAME_STEP
        run = train.train(train.Settings(env=name, steps=2 * PER_ITERATION, **SMALL), tmp_path, quiet=True)
    finally:
        del gymnasium.registry[name]
    assert run.episodes > 0
    assert max(length for _, length in run.recent) <= 20


def test_it_learns(tmp_path):
    """To balance a pole, from 6 to 60 of 1000 within a few seconds."""
    settings = train.Settings(env="stepper/InvertedPendulum-v5", steps=150 * PER_ITERATION, **SMALL)
    train.train(settings, tmp_path, quiet=True)
    rows = rows_of(tmp_path)
    assert float(rows[-1]["return"]) > 10.0 * float(rows[1]["return"])


def test_the_critic_sees_its_group_and_the_policy_the_other(tmp_path):
    """A run with an asymmetric critic continues to the same curve, and its policy acts on the group "policy" alone."""
    from envs.test_hooks import Grouped

    gymnasium.register(
        "test/Grouped-v0", vector_entry_point="stepper.envs:StepperVectorEnv", kwargs={"task": Grouped}, max_episode_steps=20
    )
    given = {"env": "test/Grouped-v0", **SMALL}
    whole = train.train(train.Settings(steps=4 * PER_ITERATION, **given), tmp_path / "whole", quiet=True)
    train.train(train.Settings(steps=2 * PER_ITERATION, **given), tmp_path / "parts", quiet=True)
    parts = train.train(train.Settings(steps=4 * PER_ITERATION, **given), tmp_path / "parts", quiet=True)
    assert rows_of(tmp_path / "parts") == rows_of(tmp_path / "whole")
    assert (whole.net.actor[0].in_features, whole.net.critic[0].in_features) == (8, 9)
    assert not np.array_equal(whole.observed["critic"].mean[:8], whole.observed["policy"].mean)
    with warnings.catch_warnings(action="error"):
        policy = load(tmp_path / "whole/policy.npz", env=make("test/Grouped-v0", 2, precision="f32"))
    assert policy(np.zeros((2, 8))).shape == (2, 1)
    np.testing.assert_array_equal(parts.policy()(np.ones(8)), policy(np.ones(8)))


def test_the_initial_deviation_is_relative_to_half_the_range_of_actions():
    """With bounds of -4 to 4, an `--initial-std` of 0.6 equals an `--action-std` of 2.4."""
    given = vars(train.arguments().parse_args(["--initial-std", "0.6"]))
    for settings in (train.Settings(initial_std=given["initial_std"]), train.Settings(action_std=2.4)):
        net = train.ActorCritic(3, 1, settings, half=np.array([4.0]))
        np.testing.assert_allclose(4.0 * torch.exp(net.log_std).detach(), 2.4, rtol=1e-6)  # rounding of 32 bits


def test_layers_activation_and_deviation_are_settings():
    given = vars(train.arguments().parse_args(["--hidden", "32,16,8", "--activation", "elu", "--action-std", "0.5"]))
    settings = train.Settings(hidden=given["hidden"], activation=given["activation"], action_std=given["action_std"])
    net = train.ActorCritic(3, 2, settings, half=np.array([1.0, 2.0]))
    assert [layer.out_features for layer in net.actor if isinstance(layer, torch.nn.Linear)] == [32, 16, 8, 2]
    assert isinstance(net.actor[1], torch.nn.ELU)
    np.testing.assert_allclose(torch.exp(net.log_std).detach(), [0.5, 0.25], rtol=1e-6)  # rounding of 32 bits
    raises(ValueError, "activation is 'gelu', must be one of tanh, elu, relu", train.Settings, activation="gelu")
