"""Scene 12: mass-ratio stacks stand, and each interface carries the weight above.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("12")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
