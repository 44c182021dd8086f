"""examples/film.py draws the policies that it names."""

import film
import numpy as np
import pytest


def test_its_policies_are_there():
    assert [name for name in film.ROBOTS if not (film.POLICIES / f"{name}.npz").exists()] == []


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_its_pictures_move():
    name, camera = film.ROBOTS["half_cheetah"]
    first, second = film.pictures(film.POLICIES / "half_cheetah.npz", name, camera, seconds=2 / film.RATE)
    assert first.shape == (film.HEIGHT, film.WIDTH, 3)
    assert np.any(first != second)
