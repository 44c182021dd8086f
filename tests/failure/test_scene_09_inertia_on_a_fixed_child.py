"""Scene 9: inertia on a fixed child body is as if merged into its parent (MuJoCo's issue 3553).

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("9")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
