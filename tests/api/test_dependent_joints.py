"""Joints whose motions cancel are refused by name: forces would not determine how they share a motion."""

import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st

BODY = '<geom size=".1" mass="4" pos=".3 0 .2"/>'


def scene(joints, body=BODY):
    return f"<mujoco><worldbody><body name='a'>{joints}{body}</body></worldbody></mujoco>"


def test_two_hinges_on_one_line_are_named_without_a_contradiction():
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(scene('<joint name="first" axis="0 1 0"/><joint name="second" axis="0 1 0"/>'))
    message = str(error.value)
    for part in ('body "a"', 'joint "first" and "second" can move without moving any inertia', "remove one of these joints", "armature"):
        assert part in message
    assert "moves nothing" not in message
    assert "4 kg" not in message
    stepper.load(scene('<joint name="first" axis="0 1 0" armature=".01"/><joint name="second" axis="0 1 0"/>'))


def test_a_body_without_mass_still_says_that_it_has_none():
    light = '<body name="b" pos="0 0 1"><joint name="only"/><geom size=".1" mass="0"/></body>'
    with pytest.raises(stepper.ModelError, match="mass"):
        stepper.load(scene('<joint name="first" axis="0 1 0"/>', BODY + light))


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 4), st.integers(0, 3), st.data())
def test_the_joints_that_are_named_are_those_that_depend(count, others, data):
    """Slides of one body in a plane: two determine it, and a third depends on both; unrelated ones along z do not matter."""
    angles = data.draw(st.lists(st.sampled_from([(1, 0), (0, 1), (1, 1), (1, -1), (2, 1)]), min_size=count, max_size=count))
    vertical = min(others, 1)
    axes = [(x, y, 0) for x, y in angles] + [(0, 0, 1)] * vertical
    joints = "".join(f'<joint name="s{i}" type="slide" axis="{x} {y} {z}"/>' for i, (x, y, z) in enumerate(axes))
    independent = len(angles) == 1 or (len(angles) == 2 and angles[0] != angles[1])
    if independent:
        stepper.load(scene(joints))
        return
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(scene(joints))
    message = str(error.value)
    assert "can move without moving any inertia" in message
    assert f'"s{len(angles)}"' not in message  # The vertical one.
