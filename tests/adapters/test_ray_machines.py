"""Ray over several machines, each of which is a node of a cluster with a process of its own: one is lost, and others come."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import ray
from ray import cloudpickle
from ray.cluster_utils import Cluster
from stepper.adapters.ray import RayVectorEnv, run_policy
from stepper.envs import StepperVectorEnv

NUM_ENVS, BLOCK = 12, 3


@pytest.fixture
def cluster():
    """A machine that asks, without a CPU for actors, and two that step."""
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    made.workers = [made.add_node(num_cpus=2) for _ in range(2)]
    ray.init(address=made.address, log_to_driver=False)
    made.wait_for_nodes()
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # Workers do not have this file.
    yield made
    ray.shutdown()
    made.shutdown()


def nodes_of(envs):
    """The machine of each actor."""
    return [ray.get(actor.__ray_call__.remote(lambda _: ray.get_runtime_context().get_node_id())) for actor in envs._actors]


def act(observation, draws):
    return np.tanh(draws.normal(size=(len(observation), 3)))


@pytest.mark.parametrize("save_every", [4, 1000])
def test_environments_of_a_machine_that_is_lost_are_made_again_to_the_same_bits(cluster, save_every):
    settings = {"max_episode_steps": 9, "autoreset_mode": "SameStep"}
    ours = RayVectorEnv("stepper/Hopper-v5", NUM_ENVS, num_actors=4, block_size=BLOCK, save_every=save_every, **settings)
    alone = StepperVectorEnv("Hopper", NUM_ENVS, **settings)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], alone.reset(seed=3)[0])
    before = nodes_of(ours)
    assert len(set(before)) == 2
    draws = np.random.default_rng(0)
    for t in range(18):
        if t == 7:  # One machine goes, and another comes.
            cluster.remove_node(cluster.workers[0], allow_graceful=False)
            cluster.add_node(num_cpus=2)
        action = draws.uniform(-1, 1, (NUM_ENVS, 3))
        for found, expected in zip(ours.step(action)[:4], alone.step(action)[:4], strict=True):
            np.testing.assert_array_equal(found, expected)
    after = nodes_of(ours)
    assert len(set(after) - set(before)) == 1
    ours.close()


def test_rollouts_have_the_bits_of_one_machine(cluster):
    settings = {"num_envs": NUM_ENVS, "num_steps": 10, "seed": 1, "block_size": BLOCK}
    spread = run_policy("stepper/Hopper-v5", act, num_actors=4, **settings)
    one = run_policy("stepper/Hopper-v5", act, num_actors=1, **settings)
    for name, values in one.items():
        np.testing.assert_array_equal(spread[name], values)


def test_what_the_page_shows_runs(cluster):
    page = (Path(__file__).parents[2] / "docs/how-to/scale_out.md").read_text()
    names = {"__name__": "__main__"}
    for snippet in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(snippet, "docs/how-to/scale_out.md", "exec"), names)
    data, again = names["data"], names["again"]
    assert data["reward"].shape == again["reward"].shape == (64, 256)
    assert np.isfinite(data["reward"]).all()
