"""Scene 42: a ball slides and rolls in a groove.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("42")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
