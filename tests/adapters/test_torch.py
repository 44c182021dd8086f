"""PyTorch: the tensors are the memory that the environments write to, and say what they say."""

import numpy as np
import pytest
import torch
from stepper.adapters.torch import TorchVectorEnv
from stepper.envs import StepperVectorEnv

NUM_ENVS = 6


def pair(**settings):
    return TorchVectorEnv("stepper/Hopper-v5", NUM_ENVS, max_episode_steps=9, **settings), StepperVectorEnv(
        "Hopper", NUM_ENVS, max_episode_steps=9, **{"dtype": "float32", **settings}
    )


@pytest.mark.parametrize("settings", [{}, {"precision": "f32"}, {"dtype": "float64"}, {"autoreset_mode": "SameStep"}])
def test_it_says_what_the_vector_environment_says(settings):
    ours, envs = pair(**settings)
    np.testing.assert_array_equal(ours.reset(seed=2)[0].numpy(), envs.reset(seed=2)[0])
    draws = np.random.default_rng(0)
    for _ in range(25):
        action = draws.uniform(-1, 1, (NUM_ENVS, 3)).astype(np.float32)
        found, expected = ours.step(torch.from_numpy(action)), envs.step(action)
        for one, other in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(one.numpy(), other.astype(one.numpy().dtype))
        assert found[4].keys() == expected[4].keys()
        assert found[1].dtype == torch.float32


def test_an_observation_stands_until_the_call_after_the_next():
    envs, _ = pair()
    action = torch.zeros(NUM_ENVS, 3)
    first, _ = envs.reset(seed=0)
    kept = first.clone()
    second = envs.step(action)[0]
    torch.testing.assert_close(first, kept, rtol=0, atol=0)
    assert second.data_ptr() != first.data_ptr()
    third = envs.step(action)[0]
    assert third.data_ptr() == first.data_ptr()
    assert not torch.equal(first, kept)


def test_a_rollout_is_written_where_the_learner_wants_it():
    ours, envs = pair()
    storage = torch.full((11, NUM_ENVS, 11), torch.nan)
    assert ours.reset(seed=1, out=storage[0])[0].data_ptr() == storage.data_ptr()
    expected = [envs.reset(seed=1)[0]]
    for t in range(10):
        ours.step(torch.ones(NUM_ENVS, 3), out=storage[t + 1])
        expected.append(envs.step(np.ones((NUM_ENVS, 3)))[0])
    np.testing.assert_array_equal(storage.numpy(), expected)
    with pytest.raises(ValueError, match="contiguous"):
        ours.step(torch.ones(NUM_ENVS, 3), out=torch.zeros(11, NUM_ENVS).T)
    with pytest.raises(ValueError, match="out has shape"):
        ours.step(torch.ones(NUM_ENVS, 3), out=torch.zeros(NUM_ENVS, 12))
    with pytest.raises(ValueError, match="contiguous tensor on the CPU"):
        ours.step(torch.ones(NUM_ENVS, 3), out=torch.zeros(NUM_ENVS, 11, device="meta"))


def test_actions_of_a_policy_that_learns_are_taken_without_their_gradient():
    envs, _ = pair()
    policy = torch.nn.Linear(11, 3)
    observation, _ = envs.reset(seed=0)
    observation, reward, *_ = envs.step(policy(observation).tanh())
    assert not observation.requires_grad
    assert not reward.requires_grad
