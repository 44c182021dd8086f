"""Tables of docs/reference/environments.md and tasks.md are those of the code, and the example of docs/how-to/terrain.md is short."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest
import stepper.envs
from page_blocks import blocks
from task_page import PAGE, page

DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_of_environments_has_every_task():
    text = (DOCS / "reference/environments.md").read_text()
    sizes = {name: int(size) for name, size in re.findall(r"`stepper/(\w+)-v5` \| (\d+) \|", text)}
    assert sizes.keys() == stepper.envs.TASKS.keys()
    for name, size in sizes.items():
        assert stepper.envs.StepperEnv(name).observation_space.shape == (size,)


@pytest.mark.skipif(
    any(find_spec(name) is None for name in ("dm_control", "mjlab", "myo_sim")),
    reason="models of dm_control, mjlab and myo_sim are not installed",
)
def test_the_page_of_tasks_is_up_to_date():
    assert PAGE.read_text() == page(), (
        "the observations or actions of a task changed: PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/task_page.py"
    )


def test_a_terrain_is_built_in_twenty_lines():
    first = next(block.text for block in blocks((DOCS / "how-to/terrain.md").read_text()) if block.language == "python")
    assert len(first.split("ground = ")[1].splitlines()) <= 20
