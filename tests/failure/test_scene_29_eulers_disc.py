"""Scene 29: Euler's disc and a coin: the energy never grows.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("29")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
