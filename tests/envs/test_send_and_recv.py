"""EnvPool's calls say what the vector environment says, and step while the caller does something else."""

import threading

import numpy as np
import pytest
from envs.cases import same
from stepper.adapters.envpool import StepperPool
from stepper.envs import StepperVectorEnv
from stepper.envs.tasks.hopper import Hopper

NUM_ENVS, LIMIT, STEPS = 12, 7, 20


def actions_of(envs, steps):
    return np.random.default_rng(3).uniform(-1, 1, (steps, NUM_ENVS, envs.action_space.shape[-1]))


def whole(actions, **settings):
    """What the vector environment says of all environments, step by step."""
    envs = StepperVectorEnv("Hopper", NUM_ENVS, max_episode_steps=LIMIT, **settings)
    observation, infos = envs.reset(seed=4)
    said = [(observation, np.zeros(NUM_ENVS), np.zeros(NUM_ENVS, dtype=bool), np.zeros(NUM_ENVS, dtype=bool), infos)]
    return said + [envs.step(action) for action in actions]


def rows(result, ids):
    """The rows of some environments; infos that none of them has are left out."""
    *arrays, infos = result
    return *(array[ids] for array in arrays), {name: value[ids] for name, value in infos.items() if value[ids].any()}


@pytest.mark.parametrize("batch_size", [1, 3, 12])
@pytest.mark.parametrize("threads", [1, 3, 0])
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_batches_have_the_bits_of_the_vector_environment(batch_size, threads, precision):
    settings = {"precision": precision, "max_episode_steps": LIMIT}
    with StepperPool("stepper/Hopper-v5", NUM_ENVS, batch_size, seed=4, threads=threads, **settings) as pool:
        actions = actions_of(pool, STEPS)
        expected = whole(actions, precision=precision)
        count = np.zeros(NUM_ENVS, dtype=int)
        pool.async_reset()
        while count.min() <= STEPS:
            result = pool.recv()
            ids = result[-1].pop("env_id")
            elapsed = result[-1].pop("elapsed_step")
            assert np.ptp(count[ids]) == 0
            found = rows(result, slice(None))
            same(found, rows(expected[count[ids[0]]], ids))
            assert (elapsed <= LIMIT).all()
            pool.send(actions[count[ids[0]] % STEPS, ids], ids)
            count[ids] += 1


def test_a_block_begins_when_each_of_its_environments_has_an_action():
    with StepperPool(Hopper, NUM_ENVS, 4, seed=4, max_episode_steps=LIMIT) as pool:
        actions = actions_of(pool, 1)
        expected = whole(actions)[1]
        pool.async_reset()
        for _ in range(3):
            pool.recv()
        pool.send(actions[0, [9, 1, 2]], [9, 1, 2])
        with pytest.raises(RuntimeError, match="no block is stepping"):
            pool.recv()
        pool.send(actions[0, [3, 0, 11, 10]], [3, 0, 11, 10])  # now 0 to 3
        pool.send(actions[0, [8]], [8])  # and 8 to 11
        for first in (0, 8):
            result = pool.recv()
            ids = result[-1].pop("env_id")
            result[-1].pop("elapsed_step")
            np.testing.assert_array_equal(ids, np.arange(first, first + 4))
            same(rows(result, slice(None)), rows(expected, ids))


class Held(Hopper):
    """Steps when it is let."""

    gate = threading.Event()

    def advance(self, now):
        assert self.gate.wait(timeout=60)
        super().advance(now)


def test_send_returns_while_others_step():
    with StepperPool(Held, 4, 2, seed=0, threads=2) as pool:
        pool.async_reset()
        ids = [pool.recv()[-1]["env_id"] for _ in range(2)]
        Held.gate.clear()
        for k in range(2):
            pool.send(np.zeros((2, 3)), ids[k])
        Held.gate.set()  # Only a send that has returned comes here.
        assert [pool.recv()[-1]["env_id"].tolist() for _ in range(2)] == [[0, 1], [2, 3]]


def test_episodes_begin_anew_and_what_was_sent_is_dropped():
    with StepperPool("stepper/Hopper-v5", 4, 2, seed=0) as pool:
        pool.async_reset()
        first = [pool.recv()[0] for _ in range(2)]
        pool.send(np.zeros((4, 3)))
        pool.async_reset()
        second = [pool.recv() for _ in range(2)]
        assert [result[-1]["elapsed_step"].tolist() for result in second] == [[0, 0], [0, 0]]
        assert not any((one == two[0]).all(axis=1).any() for one, two in zip(first, second, strict=True))
        envs = StepperVectorEnv("Hopper", 4)
        envs.reset(seed=0)
        np.testing.assert_array_equal(np.vstack([result[0] for result in second]), envs.reset()[0])


class Failing(Hopper):
    """Raises an error where an action is above 1."""

    def advance(self, now):
        if (now.action > 1.0).any():
            raise ZeroDivisionError("too large")
        super().advance(now)


def test_an_error_is_raised_once_and_the_pool_begins_anew():
    with StepperPool(Failing, 4, 2, seed=0) as pool:
        pool.async_reset()
        pool.recv(), pool.recv()
        actions = np.zeros((4, 3))
        actions[0] = 2.0
        pool.send(actions)
        with pytest.raises(ZeroDivisionError, match="too large"):
            pool.recv()
        assert pool.recv()[-1]["env_id"].tolist() == [2, 3]
        with pytest.raises(ValueError, match=r"environments \[0, 1\] already have an action.*async_reset"):
            pool.send(np.zeros((2, 3)), [0, 1])
        pool.send(np.full((2, 3), 2.0), [2, 3])
        pool.async_reset()  # An error that was not received is dropped, as results are.
        for ids in ([0, 1], [2, 3]):
            infos = pool.recv()[-1]
            assert (infos["env_id"].tolist(), infos["elapsed_step"].tolist()) == (ids, [0, 0])
        pool.send(np.zeros((4, 3)))
        assert [pool.recv()[-1]["elapsed_step"].tolist() for _ in range(2)] == [[1, 1], [1, 1]]


def test_with_one_batch_it_resets_and_steps_as_gymnasium_does():
    with StepperPool("stepper/Hopper-v5", 4, seed=0) as pool:
        assert not pool.is_async
        observation, infos = pool.reset()
        np.testing.assert_array_equal(infos["env_id"], range(4))
        assert len(pool.step(np.zeros((4, 3)))) == 5
        assert observation.shape == (4, *pool.observation_space.shape)


@pytest.mark.parametrize(("action", "env_id", "message"), [
    (np.zeros((2, 3)), [0, 5], "environments \\[5\\] already have an action"),
    (np.zeros((2, 3)), [0, 0], "env_id has environment .* more than once"),
    (np.zeros((2, 3)), [0, 12], "integers from 0 to 11"),
    (np.zeros((2, 3)), [0.0, 1.0], "integers from 0 to 11"),
    (np.zeros((2, 4)), [0, 1], "actions have shape \\(2, 4\\)"),
    (np.zeros((4, 3)), None, "actions have shape \\(4, 3\\)"),
])  # fmt: skip
def test_calls_that_make_no_sense_are_named_and_change_nothing(action, env_id, message):
    with StepperPool("stepper/Hopper-v5", NUM_ENVS, 4, seed=0) as pool:
        pool.async_reset()
        pool.recv()
        with pytest.raises(ValueError, match=message):
            pool.send(action, env_id)
        pool.send(np.zeros((4, 3)), [0, 1, 2, 3])
        with pytest.raises(RuntimeError, match="batch_size = num_envs"):
            pool.reset()


@pytest.mark.parametrize("sizes", [(12, 5), (12, 0), (0, 1), (4, 8)])
def test_sizes_that_do_not_fit_are_named(sizes):
    with pytest.raises(ValueError, match="must be a multiple of batch_size"):
        StepperPool("stepper/Hopper-v5", *sizes)


def test_other_environments_are_refused():
    with pytest.raises(TypeError, match="must have stepper"):
        StepperPool("CartPole-v1", 4)


def test_observations_are_written_where_the_caller_wants_them():
    envs, other = (StepperVectorEnv("Hopper", 3) for _ in range(2))
    out = np.full((3, 11), np.nan)
    assert envs.reset(seed=0, out=out)[0] is out
    np.testing.assert_array_equal(out, other.reset(seed=0)[0])
    assert envs.step(np.ones((3, 3)), out=out)[0] is out
    np.testing.assert_array_equal(out, other.step(np.ones((3, 3)))[0])
    with pytest.raises(ValueError, match="out has shape"):
        envs.step(np.ones((3, 3)), out=np.zeros((3, 12)))
    with pytest.raises(ValueError, match="float32"):
        envs.reset(out=out.astype(np.float32))
    np.testing.assert_array_equal(envs.step(np.ones((3, 3)))[0], other.step(np.ones((3, 3)))[0])  # It was refused before it was made.
