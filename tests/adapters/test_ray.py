"""Ray: the same bits for any number of actors."""

import os
import signal
import sys
import warnings
from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import ray
import stepper
from checks import every, raises
from ray import cloudpickle
from ray.exceptions import RayActorError, RayTaskError, WorkerCrashedError
from stepper.adapters.ray import RayVectorEnv, map_cases, run_policy
from stepper.envs import StepperVectorEnv
from stepper.envs.tasks.running import Hopper

NUM_ENVS, BLOCK, LIMIT = 10, 4, 9


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.init(num_cpus=4, include_dashboard=False, log_to_driver=False)
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # Workers do not have this file.
    yield
    ray.shutdown()


def same(found, expected):
    """Asserts that two results are the same, bit for bit, but for how long an episode took."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key in expected.keys() - {"t"}:
            same(found[key], expected[key])
    elif isinstance(expected, tuple) or expected.dtype == object:
        for one, other in zip(found, expected, strict=True):
            assert (one is None) == (other is None)
            if one is not None:
                same(one, other)
    else:
        np.testing.assert_array_equal(found, expected)


@every(num_actors=[1, 2, 3], mode=["SameStep", "NextStep"], seed=[5, [9, None, 3, 4, 1, 2, None, 8, 7, 6]])
def test_it_says_what_one_vector_environment_says(num_actors, mode, seed):
    settings = {"max_episode_steps": LIMIT, "episode_statistics": True, "autoreset_mode": mode}
    ours = RayVectorEnv("stepper/Hopper-v5", NUM_ENVS, num_actors=num_actors, block_size=BLOCK, **settings)
    envs = StepperVectorEnv("Hopper", NUM_ENVS, **settings)
    same(ours.reset(seed=0), envs.reset(seed=0))
    same(ours.reset(seed=seed), envs.reset(seed=seed))  # None goes on with the random numbers as they are.
    draws = np.random.default_rng(1)
    for _ in range(22):
        action = draws.uniform(-1, 1, (NUM_ENVS, 3))
        same(ours.step(action), envs.step(action))
    mask = np.arange(NUM_ENVS) == 9  # None of the first blocks.
    same(ours.reset(options={"reset_mask": mask}), envs.reset(options={"reset_mask": mask}))
    ours.close()


@dataclass(frozen=True)
class Linear:
    """A policy with noise, and products of matrices, whose last bits depend on how many rows there are."""

    weights: np.ndarray

    def __call__(self, observation, draws):
        return np.tanh(observation @ self.weights + 0.1 * draws.normal(size=(len(observation), 3)))


def linear(observation_size=11):
    return Linear(np.random.default_rng(0).normal(size=(observation_size, 3)))


def test_rollouts_have_the_same_bits_for_any_number_of_actors():
    def parts(num_actors):
        envs = RayVectorEnv("stepper/Hopper-v5", NUM_ENVS, num_actors=num_actors, block_size=BLOCK, max_episode_steps=LIMIT)
        envs.reset(seed=3)
        first = envs.run_policy(linear(), 15)
        second = envs.run_policy(linear(), 15)
        envs.close()
        return first, second

    expected = parts(1)
    for num_actors in (2, 3):
        for one, other in zip(parts(num_actors), expected, strict=True):
            same(one, other)
    first, second = expected
    np.testing.assert_array_equal(first["last_observation"], second["observation"][0])
    assert not np.array_equal(first["action"], second["action"])
    over = first["terminated"] | first["truncated"]
    assert over.sum() >= NUM_ENVS
    after = np.concatenate([first["observation"][1:], first["last_observation"][None]])
    np.testing.assert_array_equal(first["next_observation"][~over], after[~over])
    assert not (first["next_observation"][over] == after[over]).all(axis=1).any()


def test_a_rollout_is_what_the_vector_environment_says_of_its_actions():
    found = run_policy("stepper/Hopper-v5", linear(), NUM_ENVS, 12, seed=2, num_actors=2, block_size=BLOCK, max_episode_steps=LIMIT)
    envs = StepperVectorEnv("Hopper", NUM_ENVS, max_episode_steps=LIMIT, autoreset_mode="SameStep")
    observation, _ = envs.reset(seed=2)
    for t in range(12):
        np.testing.assert_array_equal(found["observation"][t], observation)
        observation, *said, _ = envs.step(found["action"][t])
        for name, value in zip(("reward", "terminated", "truncated"), said, strict=True):
            np.testing.assert_array_equal(found[name][t], value)


def test_a_task_of_ones_own_goes_to_the_actors():
    class Calm(Hopper):
        def reward(self, now):
            return -np.abs(now.action).sum(axis=1), {}

    found = run_policy(Calm(), linear(), 6, 5, seed=0, num_actors=2, block_size=3)
    np.testing.assert_array_equal(found["reward"], -np.abs(found["action"]).sum(axis=-1))


def test_a_policy_that_fails_is_named_and_a_seed_begins_anew():
    def failing(observation, draws):
        raise ZeroDivisionError("no action")

    envs = RayVectorEnv("stepper/Hopper-v5", 6, block_size=3)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros((6, 3)))
    envs.reset(seed=0)
    raises(ZeroDivisionError, "no action", envs.run_policy, failing, 3)
    for call in (lambda: envs.step(np.zeros((6, 3))), envs.reset):
        raises(RuntimeError, r"call reset\(seed=\.\.\.\)", call)
    observation, _ = envs.reset(seed=0)
    np.testing.assert_array_equal(observation, StepperVectorEnv("Hopper", 6).reset(seed=0)[0])
    os.kill(ray.get(envs._actors[0].__ray_call__.remote(lambda _: os.getpid())), signal.SIGKILL)
    with pytest.raises(RayActorError):
        envs.step(np.zeros((6, 3)))
    envs.close()
    raises(RuntimeError, "closed", envs.reset, seed=0)


@pytest.mark.parametrize(("settings", "message"), [
    ({"num_actors": 4}, "must be from 1 to 3"),
    ({"num_actors": 0}, "must be from 1 to 3"),
    ({"block_size": 0}, "block_size is 0"),
])  # fmt: skip
def test_settings_out_of_their_range_are_named(settings, message):
    raises(ValueError, message, RayVectorEnv, "stepper/Hopper-v5", NUM_ENVS, **{"block_size": BLOCK, **settings})


@pytest.mark.parametrize(("settings", "actors"), [
    ({}, 3),
    ({"threads": 2}, 2),
    ({"actor_options": {"num_cpus": 0}}, 3),
    ({"threads": 2, "actor_options": {"num_cpus": 1}}, 3),
])  # fmt: skip
def test_there_are_as_many_actors_as_the_cpus_are_enough_for(settings, actors):
    """Of three blocks and four CPUs: none waits for one that does not come."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*the cluster has")
        envs = RayVectorEnv("stepper/Hopper-v5", NUM_ENVS, block_size=BLOCK, **settings)
    assert len(envs._actors) == actors
    same(envs.reset(seed=0), StepperVectorEnv("Hopper", NUM_ENVS).reset(seed=0))
    envs.close()


@pytest.mark.parametrize(("settings", "message"), [
    ({"num_actors": 3, "threads": 2}, "3 actors with 2 CPUs each take 6, and the cluster has 4"),
    ({"actor_options": {"num_cpus": 5}}, "1 actors with 5 CPUs each take 5, and the cluster has 4"),
])  # fmt: skip
def test_more_than_the_cluster_has_is_said(settings, message):
    with pytest.warns(UserWarning, match=message):
        RayVectorEnv("stepper/Hopper-v5", NUM_ENVS, block_size=BLOCK, **settings).close()


def test_a_sweep_returns_results_in_the_order_of_the_cases():
    """Boxes on an incline of 0.3 rad: those with friction under tan(0.3) slide."""
    incline = stepper.load("""
        <mujoco><option gravity="2.9 0 -9.37"/><worldbody><geom type="plane" size="5 5 1"/>
        <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body></worldbody></mujoco>
    """)

    def slip(model, friction):
        sim = stepper.Stepper(model.replace(geom_friction=np.full((2, 3), [friction, 0.0, 0.0])))
        sim.step(nstep=200)
        return float(sim.qpos[0])

    frictions = [0.5, 0.1, 0.4, 0.2]
    found = map_cases(slip, frictions, incline)
    assert found == [slip(incline, friction) for friction in frictions]
    assert [value > 0.01 for value in found] == [False, True, False, True]


def test_a_case_whose_worker_is_lost_is_run_again(tmp_path):
    def once(path, case):
        if case == 2 and not path.exists():
            path.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return case**2

    assert map_cases(once, range(4), tmp_path / "was here") == [0, 1, 4, 9]

    def never(case):
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(WorkerCrashedError):
        map_cases(never, [0], attempts=0)

    def wrong(case):
        raise KeyError(case)

    with pytest.raises(RayTaskError):
        map_cases(wrong, [0])
