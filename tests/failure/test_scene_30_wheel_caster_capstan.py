"""Scene 30: a wheel does not slip sideways, a caster follows a tractrix, a rope grips a bollard.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("30")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
