"""Scene 19: Painleve's rod: an impact without collision.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("19")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
