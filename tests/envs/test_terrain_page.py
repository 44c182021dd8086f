"""Code of docs/how-to/terrain.md runs exactly as shown, and does what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs/how-to/terrain.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_its_snippets_run(capsys):
    names = {"__name__": "terrain_page"}
    for snippet in SNIPPETS:
        exec(compile(snippet, "docs/how-to/terrain.md", "exec"), names)
    heights = np.fromstring(capsys.readouterr().out.split("]")[0].replace("[", ""), sep=" ")
    assert heights.shape == (24,)
    # Balls of 0.1 m: at rest on flat ground, and in hollows of rough ground a little higher than the ground under their middle.
    assert (np.abs(heights[::4] - 0.1) < 1e-3).all()
    assert ((heights > 0.09) & (heights < 0.2)).all()
    levels = names["envs"].now.episode_state["terrain_level"]
    assert ((levels >= 0) & (levels < 6)).all()
    assert (names["envs"].now.episode_state["steps"] == 118).all()  # Two of 120 steps began another episode.
    assert np.isfinite(names["observation"]).all()
    own = names["sim"].randomized
    assert len(np.unique(own["geom_pos"][:, names["steps"][0], 0])) == 8


def test_the_first_builds_a_terrain_in_twenty_lines():
    body = SNIPPETS[0].split("ground = ")[1]
    assert len(body.splitlines()) <= 20
