"""Scene 38: crests, bowls and facets: seams of a surface of triangles are not felt.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("38")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
