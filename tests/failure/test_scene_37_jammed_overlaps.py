"""Scene 37: overlaps that nothing can undo, or that contradict one another, move nothing absurdly.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("37")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
