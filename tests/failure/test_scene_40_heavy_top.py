"""Scene 40: a heavy symmetric top about a fixed point precesses steadily, and keeps its energy and two angular momenta.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("40")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
