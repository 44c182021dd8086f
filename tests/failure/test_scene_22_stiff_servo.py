"""Scene 22: stiff servos settle at any step.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("22")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
