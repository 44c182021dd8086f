"""Scene 13: a ball on a chain of 40 links, 670 times heavier than a link.

Setup, right answer and source: benches/atlas/scenes.
"""

from atlas_cases import cases, check


@cases("13")
def test_it_holds(scene, engine, dt):
    check(scene, engine, dt)
