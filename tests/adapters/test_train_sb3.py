"""examples/train_sb3.py: it learns, and the policy that is kept acts as Stable-Baselines3's does."""

import csv

import numpy as np
import pytest
import train_sb3
from stepper.policies import evaluate, load


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
