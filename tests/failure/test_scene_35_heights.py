"""Scene 35: apexes e^(2n) H from twenty heights.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("35")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
