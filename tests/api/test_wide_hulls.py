"""Meshes that collide as a convex hull much larger than they are are named, with the remedy."""

import math
import warnings

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from loading_scenes import sheet

VALLEY = sheet([[1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
BALL = '<body pos="0 0 2"><freejoint/><geom size=".2" mass="1"/></body>'


def scene(mesh, body=BALL, inertia="shell"):
    vertices, faces = mesh
    asset = f'<asset><mesh name="m" inertia="{inertia}" vertex="{vertices}" face="{faces}"/></asset>'
    return f'<mujoco>{asset}<worldbody><geom name="ground" type="mesh" mesh="m"/>{body}</worldbody></mujoco>'


def load(text):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = stepper.load(text)
    return model, [str(w.message) for w in caught if issubclass(w.category, stepper.ModelWarning)]


def faces_of(*boxes):
    """Closed mesh of boxes (lows, highs), each of twelve triangles seen from outside."""
    corners = [[(high if k >> i & 1 else low)[i] for i in range(3)] for low, high in boxes for k in range(8)]
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [f"{8 * n + a} {8 * n + b} {8 * n + c}  {8 * n + a} {8 * n + c} {8 * n + d}" for n in range(len(boxes)) for a, b, c, d in sides]
    return "  ".join(f"{x} {y} {z}" for x, y, z in corners), "  ".join(faces)


def ratio(mesh):
    """Of the hull's volume to that of the mesh as reported; 1 where it is not worth a line."""
    found = load(scene(mesh))[0].wide_hulls
    return found[0][1] if found else 1.0


def test_a_ball_rests_above_a_valley_and_the_warning_says_why():
    model, (message,) = load(scene(VALLEY))
    assert model.wide_hulls == [(0, math.inf)]
    assert "ground: more than 100 times" in message
    assert "geom_concave" in message
    assert "ground collides as the convex hull of its mesh" in model.explain()
    sim = stepper.Stepper(model)
    sim.step(nstep=1000)
    assert sim.qpos[2] == pytest.approx(1.2, abs=1e-3)  # On the lid: 1 m and the radius; the slop is 1e-5 m.
    concave = model.replace(geom_concave=[1, 0])
    assert concave.wide_hulls == []
    assert "geom_concave=" not in concave.explain().split("Convex hulls larger than their mesh")[1]
    sim = stepper.Stepper(concave)
    sim.step(nstep=1000)
    assert sim.qpos[2] < 0.5  # In the valley: 0.2 sqrt(2) = 0.28 m at rest.


def test_a_saved_model_reports_them_and_does_not_warn_again(tmp_path):
    model, _ = load(scene(VALLEY))
    model.save(tmp_path / "valley")
    again, messages = load(tmp_path / "valley")
    assert again.wide_hulls == model.wide_hulls
    assert messages == []


@pytest.mark.parametrize("closed", [True, False])
def test_convex_solids_and_shells_are_right(closed):
    vertices, faces = faces_of(([-1, -1, -1], [1, 1, 1]))
    # Without its lid and its floor it is a tube of sheets: from outside, where its surface looks, it is the box.
    assert load(scene((vertices, faces if closed else "  ".join(faces.split("  ")[4:]))))[0].wide_hulls == []


def test_hills_are_right():
    """A dome of a height field's grid: its hull is the dome, with a floor."""
    heights = [[2 - (x * x + y * y) / 9 for x in range(-3, 4)] for y in range(-3, 4)]
    assert load(scene(sheet(heights)))[0].wide_hulls == []


def test_nothing_gets_into_a_casing():
    """A box of six thick walls is hollow, and closed."""
    walls = [
        ([-1 if j != i else s * 1 - 0.05 for j in range(3)], [1 if j != i else s * 1 + 0.05 for j in range(3)])
        for i in range(3)
        for s in (-1, 1)
    ]
    assert load(scene(faces_of(*walls)))[0].wide_hulls == []


def test_a_bin_is_open():
    """Floor and four walls with room for others in between."""
    t = 0.1
    floor, sides = ([-1, -1, 0], [1, 1, t]), [([-1, -1, 0], [t - 1, 1, 2]), ([1 - t, -1, 0], [1, 1, 2])]
    ends = [([-1, -1, 0], [1, t - 1, 2]), ([-1, 1 - t, 0], [1, 1, 2])]
    solid = 8 - (2 - 2 * t) ** 2 * (2 - t)
    # The walls are a little over one cell of the 16 along each axis thick: their volume is known to a part of that.
    assert ratio(faces_of(floor, *sides, *ends)) == pytest.approx(8 / solid, rel=0.5)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 0.9), st.floats(0.1, 0.9), st.floats(0.2, 5.0), st.integers(0, 2))
def test_the_ratio_is_that_of_an_l(a, b, size, turn):
    """Two boxes that make an L: the hull is a pentagon, cut off between the ends."""

    def turned(p):
        return [size * p[(k + turn) % 3] for k in range(3)]

    low, tall = ([0, 0, 0], [1, 1, b]), ([0, 0, 0], [a, 1, 1])
    mesh = faces_of(*((turned(x), turned(y)) for x, y in (low, tall)))
    hull, solid = 1 - (1 - a) * (1 - b) / 2, a + b - a * b
    # Shares of a volume are known to 1/16 along an axis, of which the L has two; ground has a line from 1.25 on.
    if hull / solid > 1.5:
        assert ratio(mesh) == pytest.approx(hull / solid, rel=0.3)
    if hull / solid < 1.05:
        assert ratio(mesh) == 1.0


def test_a_trench_in_a_plain_is_told():
    """Of a trench with ramps: 1.5 m wide at the top, 0.5 m at the bottom, 1 m deep."""
    trench = sheet([[1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]] * 2, 0.5)
    model, (message,) = load(scene(trench))
    # The hull goes from the rims of the plain, 3.5 m apart, to the bottom: 2 m^2, of which the trench is 1 m^2; to one of 16 points.
    assert model.wide_hulls[0][1] == pytest.approx(2.0, abs=0.15)
    assert "ground: 1.9 times" in message


def test_parts_of_robots_are_told_where_they_are_much_larger():
    """An L has less than twice its volume as a hull, a valley more than anything."""
    for mesh, told in ((faces_of(([0, 0, 0], [1, 1, 0.2]), ([0, 0, 0], [0.2, 1, 1])), False), (VALLEY, True)):
        vertices, faces = mesh
        asset = f'<asset><mesh name="m" inertia="shell" vertex="{vertices}" face="{faces}"/></asset>'
        floor = '<geom type="plane" size="9 9 1" pos="0 0 -9"/>'
        moving = f'<mujoco>{asset}<worldbody>{floor}<body name="b"><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
        _, messages = load(moving)
        assert bool(messages) == told
        assert all("#1 of body b: more than 100 times" in message for message in messages)


def test_what_is_drawn_alone_is_not_measured():
    text = scene(VALLEY).replace('name="ground"', 'name="ground" contype="0" conaffinity="0"')
    assert load(text) == (stepper.load(text), [])


def test_boxes_and_height_fields_have_no_hull():
    field = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 1 0"/></asset>'
    text = f'<mujoco>{field}<worldbody><geom type="hfield" hfield="h"/>{BALL}</worldbody></mujoco>'
    model = stepper.load(text)
    assert model.wide_hulls == []
    assert np.all(model.geom_concave == 0)
