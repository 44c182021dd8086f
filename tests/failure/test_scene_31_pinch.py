"""Scene 31: a pinch holds at 1.01 of the threshold and slips at 0.99.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("31")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
