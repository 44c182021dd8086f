"""PufferLib: its vectorizations share the buffers that the batch writes to, with the bits of the vector environment."""

import multiprocessing

import numpy as np
import pufferlib.vector
import pytest
from stepper.adapters.pufferlib import StepperPufferEnv
from stepper.envs import StepperVectorEnv

NUM_ENVS = 6
KWARGS = {"env": "stepper/Hopper-v5", "num_envs": NUM_ENVS, "max_episode_steps": 8}


def expected_of(seed, actions):
    envs = StepperVectorEnv("Hopper", NUM_ENVS, max_episode_steps=8, dtype="float32", autoreset_mode="SameStep", episode_statistics=True)
    said = [envs.reset(seed=seed)]
    return said + [envs.step(action) for action in actions]


def actions_of(steps, num_envs):
    return np.random.default_rng(0).uniform(-1, 1, (steps, num_envs, 3)).astype(np.float32)


def check(found, expected):
    observations, rewards, terminals, truncations = found
    np.testing.assert_array_equal(observations, expected[0])
    np.testing.assert_array_equal(rewards, expected[1].astype(np.float32))
    np.testing.assert_array_equal(terminals, expected[2])
    np.testing.assert_array_equal(truncations, expected[3])


def test_it_writes_to_its_buffers_what_the_vector_environment_says():
    env = pufferlib.vector.make(StepperPufferEnv, env_kwargs=KWARGS)
    assert isinstance(env, StepperPufferEnv)
    actions = actions_of(20, NUM_ENVS)
    expected = expected_of(7 * NUM_ENVS, actions)
    observations, infos = env.reset(seed=7)
    assert infos == []
    assert observations is env.observations
    np.testing.assert_array_equal(observations, expected[0][0])
    ended = 0
    for action, said in zip(actions, expected[1:], strict=True):
        *found, infos = env.step(action)
        assert found[0] is env.observations
        check(found, said)
        over = said[2] | said[3]
        assert len(infos) == over.any()
        if infos:
            ended += 1
            assert infos[0]["episode_length"] == said[4]["episode"]["l"][over].mean()
            assert infos[0]["episode_return"] == said[4]["episode"]["r"][over].mean()
    assert ended >= 2
    first = env.observations.copy()
    env.reset()
    assert not (env.observations == first).all(axis=1).any()


def test_its_workers_have_environments_of_their_own_seeds():
    """Two processes, which write to shared memory; the first batch that is ready comes first."""
    assert multiprocessing.get_start_method() in ("fork", "forkserver", "spawn")
    actions = actions_of(12, NUM_ENVS)
    envs = pufferlib.vector.make(
        StepperPufferEnv, env_kwargs=KWARGS, backend=pufferlib.vector.Multiprocessing, num_envs=2, num_workers=2, batch_size=1, seed=0
    )
    envs.async_reset(seed=3)
    count, said = {}, {}
    while len(count) < 2 or min(count.values()) < 12:
        observations, rewards, terminals, truncations, *_, agents, _ = envs.recv()
        worker = int(agents[0]) // NUM_ENVS
        np.testing.assert_array_equal(agents, np.arange(NUM_ENVS) + worker * NUM_ENVS)
        at = count.get(worker, 0)
        said.setdefault(worker, []).append([part.copy() for part in (observations, rewards, terminals, truncations)])
        count[worker] = at + 1
        envs.send(actions[at % 12])
    envs.close()
    starts = []
    for worker, found in said.items():
        seeds = [seed for seed in (3, 4) if (expected_of(seed * NUM_ENVS, [])[0][0] == found[0][0]).all()]
        assert len(seeds) == 1, worker
        starts += seeds
        expected = expected_of(seeds[0] * NUM_ENVS, actions)
        for one, other in zip(found[1:12], expected[1:12], strict=True):
            check(one, other)
    assert sorted(starts) == [3, 4]


def test_spaces_that_pufferlib_refuses_are_none_of_ours():
    envs = pufferlib.vector.make(StepperPufferEnv, env_kwargs=KWARGS, backend=pufferlib.vector.Serial, num_envs=2)
    observations, _ = envs.reset(seed=1)
    assert observations.shape == (2 * NUM_ENVS, 11)
    assert observations in envs.observation_space
    with pytest.raises(pufferlib.APIUsageError):
        envs.step(np.zeros((1, 3), dtype=np.float32))
