"""Scene 39: a joint that begins half a radian outside its range comes back and rests.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("39")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
