"""Scene 16: a house of cards and an arch stand, dominoes fall in order.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("16")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
