"""Scene 15: a table on four legs: one sum of forces, one motion, whatever the order of contacts.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("15")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
