"""Ray over several machines, each of which is a node of a cluster with a process of its own."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import ray
from ray import cloudpickle
from ray.cluster_utils import Cluster
from stepper.adapters.ray import run_policy

NUM_ENVS, BLOCK = 12, 3


@pytest.fixture
def cluster():
    """A machine that asks, without a CPU for actors, and two that step."""
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    for _ in range(2):
        made.add_node(num_cpus=2)
    ray.init(address=made.address, log_to_driver=False)
    made.wait_for_nodes()
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # Workers do not have this file.
    yield made
    ray.shutdown()
    made.shutdown()


def act(observation, draws):
    return np.tanh(draws.normal(size=(len(observation), 3)))


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
