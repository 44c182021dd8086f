"""What docs/reference/environments.md shows runs."""

import re
from pathlib import Path

import numpy as np
import stepper.envs

PAGE = (Path(__file__).parents[2] / "docs/reference/environments.md").read_text()


def test_its_snippets_run():
    names = {}
    # What is drawn needs OpenGL and moviepy: tests/viewer/test_snippets.py.
    for snippet in (s for s in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "render_mode" not in s):
        exec(compile(snippet.replace("1024", "8"), "docs/reference/environments.md", "exec"), names)
    assert names["env"].unwrapped.task.frame_skip == 2
    assert np.isfinite(names["observation"]).all()


def test_its_table_has_every_task():
    sizes = {name: int(size) for name, size in re.findall(r"`stepper/(\w+)-v5` \| (\d+) \|", PAGE)}
    assert sizes.keys() == stepper.envs.TASKS.keys()
    for name, size in sizes.items():
        assert stepper.envs.StepperEnv(name).observation_space.shape == (size,)
