"""Scene 34: billiards at five phases of the step, normals those of the impact.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("34")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
