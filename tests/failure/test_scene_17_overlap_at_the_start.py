"""Scene 17: boxes that overlap at the start separate without a pop.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("17")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
