"""Scene 32: a tray holds 2 N iff that is below mu N, whatever the step.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("32")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
