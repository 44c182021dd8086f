"""Scene 21: a steady force on a wall, no bump over seams.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("21")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
