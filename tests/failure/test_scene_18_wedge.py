"""Scene 18: a wedge is held iff tan alpha <= mu.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("18")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
