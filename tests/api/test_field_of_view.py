"""What a camera has in view: a pyramid ahead of it."""

import math

import numpy as np
import pytest
import stepper

SCENE = """<mujoco><worldbody><body name="camera" pos="{place} 0 1" euler="180 0 0"><site name="camera"/></body>
  <body name="box" pos="0 0 .04"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
  <joint name="z" type="slide" axis="0 0 1"/><geom size=".04"/><site name="box"/></body></worldbody>
  <sensor><framepos name="camera" objtype="site" objname="box" reftype="site" refname="camera"/></sensor></mujoco>"""


def test_the_edges_of_the_view_are_where_their_angles_are():
    view = stepper.sensors.FieldOfView(width=1.0, height=0.5, near=0.1, far=2.0)
    right, down = math.tan(0.5), math.tan(0.25)
    inside = [[0, 0, 1], [0.999 * right, 0, 1], [0, -0.999 * down, 1], [1.9 * right, 0, 1.91], [0, 0, 0.1], [0, 0, 2]]
    outside = [[1.001 * right, 0, 1], [0, 1.001 * down, 1], [0, 0, -1], [0, 0, 0.09], [0, 0, 2.01], [np.nan, 0, 1], [0, 0, np.nan]]
    assert view.sees(inside).tolist() == [True] * len(inside)
    assert view.sees(outside).tolist() == [False] * len(outside)
    assert view.sees([0, 0, 1])
    # Nothing is seen from where the camera is, whatever the least distance.
    assert not stepper.sensors.FieldOfView(width=1.0, height=1.0).sees([0.0, 0.0, 0.0])


def test_environments_may_have_a_view_each():
    view = stepper.sensors.FieldOfView(width=np.array([0.2, 0.4]), height=0.2)
    assert view.sees([[0.15, 0, 1], [0.15, 0, 1]]).tolist() == [False, True]


def test_what_is_not_in_view_keeps_its_last_reading():
    view = stepper.sensors.FieldOfView(width=1.0, height=1.0)
    never = np.full((2, 4), np.nan)
    first = view.detect([[0, 0, 1, 7], [9, 0, 1, 7]], never)
    np.testing.assert_array_equal(first, [[0, 0, 1, 7], [np.nan] * 4])
    np.testing.assert_array_equal(view.detect([[9, 0, 1, 8], [0.1, 0, 1, 8]], first), [[0, 0, 1, 7], [0.1, 0, 1, 8]])


@pytest.mark.parametrize("place", [0.0, 0.05])
def test_it_is_asked_in_the_frame_of_a_sensor(place):
    """A box that goes along x leaves the view of a camera above it where the edge meets the box's height."""
    model = stepper.load(SCENE.format(place=place))
    edge = (1.0 - 0.04) * math.tan(0.5 * 0.6)
    ways = np.array([-1.001, -0.999, 0.999, 1.001]) * edge + place
    sim = stepper.Stepper(model, 4)
    sim.reset(qpos=np.array([[x, 0.0, 0.0] for x in ways]))
    reading = np.asarray(sim.sensordata_ideal)
    np.testing.assert_allclose(reading, np.array([[x - place, 0.0, 0.96] for x in ways]), atol=1e-12)
    assert stepper.sensors.FieldOfView(width=0.6, height=0.1).sees(reading).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"width": 0.0, "height": 1.0}, "width is 0.0, must be between 0 and pi"),
        ({"width": 1.0, "height": 60.0}, "height is 60.0, must be between 0 and pi: the whole angle between two edges, in rad"),
        ({"width": np.array([1.0, np.nan]), "height": 1.0}, "width is"),
        ({"width": 1.0, "height": 1.0, "near": 2.0, "far": 1.0}, "near is 2.0 and far is 1.0"),
        ({"width": 1.0, "height": 1.0, "near": -1.0}, "near is -1.0"),
        ({"width": "wide", "height": 1.0}, "width is 'wide', must be an array of numbers"),
        ({"width": 1.0, "height": 1.0, "near": None}, "near is None, must be"),
        ({"width": 1.0, "height": 1.0, "far": [1.0, 2.0]}, r"far is \[1.0, 2.0\], must be distances"),
    ],
)
def test_a_wrong_view_is_named(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        stepper.sensors.FieldOfView(**given)


def test_rows_that_are_no_positions_are_named():
    view = stepper.sensors.FieldOfView(width=1.0, height=1.0)
    with pytest.raises(ValueError, match=r"position has the shape \(2, 2\), must be \(num_envs, 3\)"):
        view.sees(np.zeros((2, 2)))
    with pytest.raises(TypeError, match=r"position is \[\['a'\]\], must be an array of numbers"):
        view.sees([["a"]])
    with pytest.raises(ValueError, match=r"reading has the shape \(2, 3\) and last \(1, 3\)"):
        view.detect(np.zeros((2, 3)), np.zeros((1, 3)))
