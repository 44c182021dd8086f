"""Scene 24: a chain against its joint limits gains no energy.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("24")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
