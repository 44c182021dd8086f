"""Scene 27: 1e5 m away the motion is the same.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("27")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
