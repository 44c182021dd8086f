"""Scene 41: a tall box tips at 1.001 of the critical force or slope, and stands at 0.999.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("41")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
