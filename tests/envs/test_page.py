"""The table of tasks in docs/reference/environments.md is that of the code."""

import re
from pathlib import Path

import stepper.envs

PAGE = (Path(__file__).parents[2] / "docs/reference/environments.md").read_text()


def test_its_table_has_every_task():
    sizes = {name: int(size) for name, size in re.findall(r"`stepper/(\w+)-v5` \| (\d+) \|", PAGE)}
    assert sizes.keys() == stepper.envs.TASKS.keys()
    for name, size in sizes.items():
        assert stepper.envs.StepperEnv(name).observation_space.shape == (size,)
