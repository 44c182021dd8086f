"""Scene 23: loops stay closed through singularities.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("23")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
