"""Scene 43: bodies fly past a box and keep their velocity.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("43")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
