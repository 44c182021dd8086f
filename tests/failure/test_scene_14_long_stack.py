"""Scene 14: ten equal boxes stand for 1e5 steps without drift or jitter.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


# A hundred thousand steps take eight seconds.
@cases("14", others=["stepper baumgarte", "stepper newton"])
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
