"""Scene 20: two boxes on hinges, faces aligned (DART's issue 892).

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("20")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
