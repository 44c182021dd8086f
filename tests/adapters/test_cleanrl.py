"""CleanRL's script style: examples/train_cleanrl.py, with the native batch in place of `SyncVectorEnv`."""

import numpy as np
import torch
import train_cleanrl
from stepper.policies import evaluate, load

SMALL = train_cleanrl.Settings(num_envs=32, epochs=6, minibatch=256, gamma=0.98)
NAME = "stepper/InvertedPendulum-v5"


def envs_of(**settings):
    return train_cleanrl.make_envs(NAME, SMALL.num_envs, SMALL.gamma, **settings)


def test_it_learns():
    """Returns of episodes of at most 200 actions, with a reward of 1 for each; a random policy gets less than 30."""
    wrapped = envs_of(max_episode_steps=200, precision="f32")
    agent, returns = train_cleanrl.train(wrapped, 1, 24, SMALL)
    assert returns[0] < 30
    assert np.nanmax(returns) > 150
    # The saved policy is the mean of the agent's actions.
    policy = train_cleanrl.policy_of(agent, wrapped, {})
    observation = np.random.default_rng(0).normal(size=(9, 4)).astype(np.float32)
    moments = wrapped.normalized.obs_rms
    normalized = np.clip((observation - moments.mean) / np.sqrt(moments.var + wrapped.normalized.epsilon), -10, 10)
    expected = agent.actor(torch.as_tensor(normalized, dtype=torch.float32)).detach().numpy()
    # Both compute in f32, in another order of operations.
    np.testing.assert_allclose(policy(observation), np.clip(expected, policy.low, policy.high), atol=1e-5)


def test_the_same_seed_learns_the_same():
    """To the bit, with several threads."""
    first, second = (train_cleanrl.train(envs_of(max_episode_steps=50, threads=threads), 3, 5, SMALL)[1] for threads in (1, 2))
    assert first == second


def test_the_script_writes_a_curve_and_a_policy(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [train_cleanrl.__file__, NAME, "--steps", "8192", "--num-envs", "32", "--out", str(tmp_path)])
    train_cleanrl.main()
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 1 + 8192 // (32 * train_cleanrl.Settings().num_steps)
    found = evaluate(load(tmp_path / "policy.npz"), NAME, episodes=3, seed=train_cleanrl.FRESH, precision="f32")
    assert str(found) != ""
    assert f"{NAME}: " in capsys.readouterr().out
