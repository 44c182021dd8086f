"""EnvPool: a loop that was written for it says the same of ours, and episodes begin where they do there."""

import envpool
import envpool_vector
import gymnasium
import numpy as np
import pytest
from stepper.adapters.envpool import StepperPool

NUM_ENVS, BATCH, LIMIT, RECEIVED = 6, 2, 5, 60


def pools():
    made = envpool.make_gymnasium("HalfCheetah-v5", num_envs=NUM_ENVS, batch_size=BATCH, seed=0, num_threads=1, max_episode_steps=LIMIT)
    return {"ours": StepperPool("stepper/HalfCheetah-v5", NUM_ENVS, BATCH, seed=0, max_episode_steps=LIMIT), "EnvPool's": made}


def loop(pool):
    """What each environment says, in its order: (elapsed_step, terminated, truncated, whether its reward is zero)."""
    said = {k: [] for k in range(NUM_ENVS)}
    draws = np.random.default_rng(0)
    pool.async_reset()
    for _ in range(RECEIVED):
        observation, reward, terminated, truncated, info = pool.recv()
        ids = info["env_id"]
        assert observation.shape == (BATCH, *pool.observation_space.shape)
        assert (ids.dtype, info["elapsed_step"].dtype, terminated.dtype, truncated.dtype) == (np.int32, np.int32, bool, bool)
        for k, row in zip(ids.tolist(), zip(info["elapsed_step"], terminated, truncated, reward == 0, strict=True), strict=True):
            said[k].append(tuple(value.item() for value in row))
        pool.send(draws.uniform(-1, 1, (BATCH, *pool.action_space.shape)), ids)
    return said


def test_the_same_loop_runs_in_both():
    ours, theirs = (loop(pool) for pool in pools().values())
    for k in range(NUM_ENVS):
        both = min(len(ours[k]), len(theirs[k]))  # Theirs come as they are ready.
        assert both > 2 * LIMIT
        assert ours[k][:both] == theirs[k][:both]
        assert ours[k][LIMIT] == (LIMIT, False, True, False)
        assert ours[k][LIMIT + 1] == (0, False, False, True)  # The action was ignored, and the episode begun.


def test_environments_of_a_batch_that_end_at_different_steps():
    """Hoppers fall when they fall: each says so at its own step, does nothing in the next one, and its episode begins, in both."""
    ours = StepperPool("stepper/Hopper-v5", NUM_ENVS, seed=0)
    theirs = envpool.make_gymnasium("Hopper-v5", num_envs=NUM_ENVS, seed=0, num_threads=1)
    for pool in (ours, theirs):
        draws = np.random.default_rng(1)
        pool.async_reset()
        observation, _, _, _, info = pool.recv()
        elapsed, over, ends = np.asarray(info["elapsed_step"]), np.zeros(NUM_ENVS, dtype=bool), [set() for _ in range(NUM_ENVS)]
        assert not elapsed.any()
        partial = 0
        for step in range(300):
            # Their batches come in the order of ids where they are whole.
            pool.send(draws.uniform(-1, 1, (NUM_ENVS, 3)), np.arange(NUM_ENVS))
            observation, reward, terminated, truncated, info = pool.recv()
            assert info["env_id"].tolist() == list(range(NUM_ENVS))
            # An episode that was over begins: its action is ignored. The others go on.
            assert info["elapsed_step"].tolist() == np.where(over, 0, elapsed + 1).tolist()
            assert (reward[over] == 0).all()
            assert (reward[~over] != 0).all()
            assert not (terminated | truncated)[over].any()
            # At its start a hopper stands upright, at 1.25 m.
            assert (np.abs(observation[over, 0] - 1.25) < 0.01).all()
            assert not truncated.any()
            elapsed, over = info["elapsed_step"].astype(int), terminated | truncated
            partial += 0 < over.sum() < NUM_ENVS
            for env in np.flatnonzero(over):
                ends[env].add(step)
        # Some end where others go on, every one has ended, and no two of them always together.
        assert partial > NUM_ENVS
        assert len({frozenset(own) for own in ends}) == NUM_ENVS


@pytest.mark.parametrize("name", ["ours", "EnvPool's"])
def test_properties_are_theirs(name):
    pool = pools()[name]
    assert len(pool) == NUM_ENVS
    assert pool.is_async
    assert pool.all_env_ids.tolist() == list(range(NUM_ENVS))
    assert (pool.config["num_envs"], pool.config["batch_size"], pool.config["num_threads"]) == (NUM_ENVS, BATCH, 1)
    assert pool.observation_space.shape == (17,)
    assert pool.action_space.shape == (6,)


def test_its_environments_train_as_a_vector_environment_of_gymnasiums():
    """Episodes that are over begin again within the step, with their last observations beside."""
    envs = envpool_vector.EnvPoolVectorEnv("HalfCheetah-v5", 6)
    observation, _ = envs.reset(seed=3)
    np.testing.assert_array_equal(envs.reset(seed=3)[0], observation)
    assert (envs.reset(seed=4)[0] != observation).any()
    action = np.zeros(envs.action_space.shape)
    for _ in range(999):
        observation, _, _, truncated, info = envs.step(action)
        assert not truncated.any()
        assert not info
    first, _, terminated, truncated, info = envs.step(action)
    assert truncated.all()
    assert not terminated.any()
    # A step without control changes little after a thousand of them; an episode begins elsewhere.
    assert np.abs(np.stack(list(info["final_obs"])) - observation).max() < 0.05
    assert np.abs(first - observation).max(axis=1).min() > 0.05
    assert not envs.step(action)[3].any()


def test_another_autoreset_is_refused():
    with pytest.raises(ValueError, match=r"must be AutoresetMode\.SAME_STEP"):
        envpool_vector.EnvPoolVectorEnv("HalfCheetah-v5", 2, autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED)
