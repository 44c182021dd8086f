"""Values that the code blocks of pages must leave, by page: `page_blocks.run` returns the names."""

import numpy as np


def nothing(names):
    """A page whose blocks need no further check."""


def quantities(names):
    assert names["depth"].shape == names["geoms"].shape == (64, 187)
    assert len(names["some"]) == 2


def finite_observation(names):
    assert np.isfinite(names["observation"]).all()


def terrain(names):
    heights = np.fromstring(names["printed"].split("]")[0].replace("[", ""), sep=" ")
    assert heights.shape == (24,)
    # Balls of 0.1 m: at rest on flat ground, and in hollows of rough ground a little higher than the ground under their middle.
    assert (np.abs(heights[::4] - 0.1) < 1e-3).all()
    assert ((heights > 0.09) & (heights < 0.2)).all()
    levels = names["envs"].now.episode_state["terrain_level"]
    assert ((levels >= 0) & (levels < 6)).all()
    finite_observation(names)
    own = names["sim"].randomized
    assert len(np.unique(own["geom_pos"][:, names["steps"][0], 0])) == 8


CHECKS = {
    "docs/reference/quantities.md": quantities,
    "docs/reference/environments.md": finite_observation,
    "docs/how-to/train.md": finite_observation,
    "docs/how-to/terrain.md": terrain,
}
