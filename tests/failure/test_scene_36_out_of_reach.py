"""Scene 36: what is out of reach is stretched towards, and rests.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("36")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
