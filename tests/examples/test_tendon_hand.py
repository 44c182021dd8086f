"""The largest balls that the hand on tendons holds are those on the page of the examples."""

from pathlib import Path

import numpy as np
import pytest
import tendon_hand


@pytest.mark.parametrize("tension", [10.0, 40.0])
def test_the_largest_balls_are_those_of_the_page(tension):
    masses = np.linspace(0.01, 0.6, 60)
    still, shaken = tendon_hand.largest(tension, masses)
    line = f"| {tension:.0f} N | {still:.2f} kg | {shaken:.2f} kg |"
    assert line in (Path(tendon_hand.__file__).parent / "README.md").read_text(encoding="utf-8")
    assert masses[0] < still < masses[-1]


def test_a_ball_that_is_held_rests_in_the_hand():
    sim, moved = tendon_hand.hold(np.array([0.2]), 40.0)
    # At rest the ball does not move against the hand by more than a contact's slop, 0.1 mm.
    assert moved[0, 0] < 1e-4
    assert sim.status == 0
