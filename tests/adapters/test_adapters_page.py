"""What docs/reference/adapters.md shows runs, and its versions are those that are tested."""

import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import ray

PAGE = (Path(__file__).parents[2] / "docs/reference/adapters.md").read_text()
SECTIONS = dict(re.findall(r"^## (.+)\n(?:(?!## ).*\n)*?```python\n((?:.*\n)*?)```", PAGE, re.MULTILINE))


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.init(num_cpus=4, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::FutureWarning")
@pytest.mark.parametrize("name", SECTIONS)
def test_its_snippets_run(name):
    names = {"__name__": "__main__"}
    exec(compile(SECTIONS[name], f"docs/reference/adapters.md, {name}", "exec"), names)
    if "observation" in names:
        assert np.isfinite(np.asarray(names["observation"])).all()
    if "algorithm" in names:
        assert np.isfinite(names["algorithm"].train()["env_runners"]["episode_return_mean"])
        names["algorithm"].stop()


def test_every_library_of_its_table_has_an_example():
    assert len(SECTIONS) == PAGE.count("```python") == 6


@pytest.mark.parametrize(("library", "package"), [
    ("Stable-Baselines3", "stable-baselines3"),
    ("rsl_rl 5", "rsl-rl-lib"),
    ("TorchRL", "torchrl"),
    ("RLlib, new API stack", "ray"),
    ("CleanRL", "gymnasium"),
    ("Ray", "ray"),
])  # fmt: skip
def test_versions_are_those_of_the_table(library, package):
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| {library} |"))
    assert row.rstrip(" |").endswith(version(package).split("+")[0])
