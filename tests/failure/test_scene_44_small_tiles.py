"""Scene 44: bodies slide over the seams of small tiles.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("44")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
