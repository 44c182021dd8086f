"""Scene 33: a ball on a turntable moves on a circle with two sevenths of its rate.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("33")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
