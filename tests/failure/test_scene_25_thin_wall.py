"""Scene 25: a fast sphere does not pass a thin wall.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("25")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
