"""What docs/how-to/terrain.md and docs/how-to/urdf.md show runs."""

import re
import warnings
from pathlib import Path

import pytest
import stepper

DOCS = Path(__file__).parents[1] / "docs"


def run(page):
    """The names that the page's snippets leave, one after the other, without the warnings that the page is about."""
    names = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        for snippet in re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL):
            exec(compile(snippet, page, "exec"), names)
    return names


def test_terrain():
    names = run("terrain.md")
    assert names["model"].wide_hulls == []


def test_robot_files():
    names = run("robot_files.md")
    assert len(names["model"].excluded_overlaps) == 1
    # The servo's natural frequency is 5 Hz, so that a second is five periods; the slide of the upper arm bears no weight about its axis.
    assert names["sim"].qpos[0] == pytest.approx(0.5, abs=1e-3)
