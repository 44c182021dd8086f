"""Scene 26: Newton's cradle: momentum and energy, one ball after another.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("26")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
