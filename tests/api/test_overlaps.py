"""Overlaps at the reference pose: `stepper.load(..., overlaps="exclude")`."""

import math
import re
import warnings

import mujoco
import numpy as np
import pytest
import stepper
from hypothesis import given, settings, strategies as st
from loading_scenes import arm, joint, link, robot, sheet, sphere
from models import mjcf, simulate
from stepper.cli.studies import explain

SLOP = 1e-5
"""m: position correction leaves overlaps of this size, the default of Options.slop."""

CHAIN = """<mujoco><worldbody>{ground}<body name="a" pos="0 0 1">{joint}<geom name="ga" size=".3" mass="1"/>
  <body name="b" pos=".2 0 0"><joint axis="0 0 1"/><geom name="gb" size=".1" mass="1"/>
  <body name="c" pos=".2 0 0"><joint axis="0 1 0"/><geom name="gc" size=".15" mass="1"/></body></body></body></worldbody></mujoco>"""
FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
SPIN = '<joint axis="0 0 1"/>'
KEYS = mjcf("keyframes_that_overlap")
LEG = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="base" pos="0 0 1"><freejoint/><geom name="trunk" size=".1"/>
  <body name="leg"><joint name="j" axis="0 1 0"/><geom name="foot" pos="0 0 -.4" size=".03"/></body></body></worldbody>
  <keyframe>{keys}</keyframe></mujoco>"""


def load(source, **arguments):
    with warnings.catch_warnings(record=True, action="always") as caught:
        model = stepper.load(source, **{"overlaps": "exclude"} | arguments)
    return model, [str(w.message) for w in caught if issubclass(w.category, stepper.ModelWarning)]


def contacts_of(model, qpos=None):
    """Contacts at a pose, or the reference pose: those of a step in which nothing moves."""
    return simulate(model, timestep=1e-9, stabilization="none", qpos=model.qpos0 if qpos is None else qpos, steps=1).contacts()


def overlapping(model):
    """Bodies of the contacts at the reference pose that overlap."""
    contacts = contacts_of(model)
    return [tuple(sorted(pair)) for pair in contacts["body"][contacts["distance"] < -SLOP].tolist()]


def test_links_that_overlap_do_not_collide_and_are_listed():
    kept = stepper.load(CHAIN.format(ground="", joint=SPIN))
    assert [(a, b) for a, b, _ in kept.overlaps()] == [("ga", "gc")]
    assert 'overlaps="exclude"' in kept.explain()
    model, (message,) = load(CHAIN.format(ground="", joint=SPIN))
    assert overlapping(model) == []
    ((one, other, depth),) = model.excluded_overlaps
    assert (one, other) == ("ga", "gc")
    assert depth == pytest.approx(0.05, abs=1e-12)  # 0.3 + 0.15 - 0.4, rounded
    assert "ga and gc by 50.00 mm" in message
    assert "ga and gc overlap by 50.00 mm" in model.explain().split("Excluded from contact")[1]
    assert not stepper.Status(int(simulate(model, steps=20).status)) & (stepper.Status.INFEASIBLE | stepper.Status.DEEP)


def test_the_bodies_do_not_collide_with_their_other_geoms_either():
    """As links in SRDF and <exclude>: geoms beside those that overlap would jam when the joint moves."""
    scene = CHAIN.format(ground="", joint=SPIN).replace(
        "</body></body></body>", '<geom name="tip" size=".01" pos="0 0 .5"/></body></body></body>'
    )
    model, _ = load(scene)
    # At this angle the tip of the last link is in the sphere of the first one.
    pose = [0, 0, -1.2]
    assert len(contacts_of(model, pose)) == 0
    assert len(contacts_of(stepper.load(scene), pose)) == 2


@pytest.mark.parametrize("ground", [FLOOR, '<geom name="floor" type="box" size="9 9 .5"/>'])
def test_a_free_robot_in_the_ground_stays_and_is_told(ground):
    model, (message,) = load(CHAIN.format(ground=ground, joint="<freejoint/>").replace('pos="0 0 1"', 'pos="0 0 .2"'))
    assert [names[:2] for names in model.excluded_overlaps] == [("ga", "gc")]
    assert {body for pair in overlapping(model) for body in pair} >= {0, 1}
    assert "does not change overlaps with the ground" in message
    assert "floor and ga" in message or "ga and floor" in message


def test_of_the_world_the_geom_alone_is_excluded():
    """A robot's pedestal is often a geom of the world, beside the floor and the walls."""
    pedestal = FLOOR + '<geom name="pedestal" type="box" size=".2 .2 .5" pos="0 0 .5"/><geom name="wall" size=".1" pos="2 0 1"/>'
    model, _ = load(CHAIN.format(ground=pedestal, joint=SPIN))
    assert {frozenset(names[:2]) for names in model.excluded_overlaps} == {
        frozenset(p) for p in (("ga", "gc"), ("ga", "pedestal"), ("gb", "pedestal"))
    }
    # The wall and the floor are moved into the arm.
    places = model.geom_pos.copy()
    places[model.geom("floor").id], places[model.geom("wall").id] = [0, 0, 0.95], [0.35, 0, 1]
    names = {tuple(sorted(pair)) for pair in contacts_of(model.replace(geom_pos=places))["geom"].tolist()}
    index = {name: model.geom(name).id for name in ("floor", "wall", "ga", "pedestal")}
    assert (index["floor"], index["ga"]) in names
    assert (index["wall"], index["ga"]) in names
    assert (index["pedestal"], index["ga"]) not in names


def test_the_base_of_a_urdf_is_a_link():
    model, (message,) = load(arm(base=sphere(0.6), upper=sphere(0.5)))
    assert "#0 of body world" in message
    assert overlapping(model) == []


def test_explicit_pairs_that_overlap_are_excluded_too():
    scene = CHAIN.format(ground="", joint=SPIN).replace("</worldbody>", '</worldbody><contact><pair geom1="ga" geom2="gc"/></contact>')
    assert overlapping(stepper.load(scene)) == [(1, 3)]
    assert overlapping(load(scene)[0]) == []


def test_sources_copies_and_variants_agree(tmp_path):
    text = CHAIN.format(ground="", joint=SPIN)
    model, _ = load(text)
    assert load(mujoco.MjModel.from_xml_string(text))[0] == model
    model.save(tmp_path / "excluded")
    assert load(tmp_path / "excluded", overlaps="keep")[0] == model
    stepper.load(text).save(tmp_path / "kept")
    again, (message,) = load(tmp_path / "kept")
    assert again == model
    assert "ga and gc by" in message
    assert model.digest != stepper.load(text).digest
    heavier = model.replace(body_mass=2 * model.body_mass)
    assert heavier.excluded_overlaps == model.excluded_overlaps
    assert overlapping(heavier) == []
    # A variant with larger geoms is asked again.
    assert overlapping(model.replace(geom_size=model.geom_size * 1.4).exclude_overlaps()) == []


def test_keyframes_do_not_count():
    """A keyframe is a pose that somebody chose: the overlap there is that keyframe's, and the pair may part."""
    scene = CHAIN.format(ground="", joint=SPIN).replace(
        "</worldbody>", '</worldbody><keyframe><key qpos="0 0 0"/><key qpos="0 3 0"/></keyframe>'
    )
    apart = scene.replace('pos=".2 0 0"><joint axis="0 1 0"', 'pos=".3 0 0"><joint axis="0 1 0"')
    model, (message,) = load(apart)
    assert model == load(apart, overlaps="keep")[0]
    assert model.excluded_overlaps == []
    # The second joint has turned the last geom into the first one.
    depth = 0.3 + 0.15 - math.hypot(0.2 + 0.3 * math.cos(3.0), 0.3 * math.sin(3.0))
    assert f"  #1: ga and gc by {1e3 * depth:.2f} mm" in message


@pytest.mark.parametrize(("depth", "listed"), [(0.5 * SLOP, False), (2 * SLOP, True), (8 * SLOP, True)])
def test_overlaps_lists_what_exclude_excludes(depth, listed):
    """Both have the threshold of position correction."""
    scene = CHAIN.format(ground="", joint=SPIN).replace('name="gc" size=".15"', f'name="gc" size="{0.1 + depth!r}"')
    kept, excluded = stepper.load(scene), stepper.load(scene).exclude_overlaps()
    assert [names[:2] for names in kept.overlaps()] == ([("ga", "gc")] if listed else [])
    assert [names[:2] for names in excluded.excluded_overlaps] == [names[:2] for names in kept.overlaps()]
    assert excluded.overlaps() == []


@st.composite
def trees(draw):
    """A tree of up to six links with spheres, on the world or free."""
    count = draw(st.integers(2, 6))
    number = st.floats(0.02, 0.4)
    spheres = [[sphere(draw(number), draw(st.floats(-0.5, 0.5))) for _ in range(draw(st.integers(1, 2)))] for _ in range(count)]
    links = [link(f"l{i}", "".join(found)) for i, found in enumerate(spheres)]
    joints = [
        joint(f"j{i}", f"l{draw(st.integers(0, i - 1))}", f"l{i}", kind="continuous", x=draw(st.floats(0.05, 0.8))) for i in range(1, count)
    ]
    free = ('<link name="world"/>', joint("root", "world", "l0", kind="floating")) if draw(st.booleans()) else ()
    return robot(*free, *links, *joints)


@settings(max_examples=60, deadline=None)
@given(trees())
def test_nothing_overlaps_and_what_is_apart_collides(text):
    kept, (model, _) = stepper.load(text), load(text)
    assert overlapping(model) == []
    before, after = (_colliding_bodies(m) for m in (kept, model))
    lost = {pair for pair in before - after if 0 not in pair}
    assert lost == {pair for pair in overlapping(kept) if 0 not in pair}


def _colliding_bodies(model):
    """Pairs of bodies whose geoms meet where all bodies are in one place: contacts of a model whose geoms are larger than the robot."""
    large = model.replace(geom_size=np.where(model.geom_size > 0, 9.0, 0.0))
    return {tuple(sorted(pair)) for pair in contacts_of(large)["body"].tolist()}


def test_keyframes_with_deep_overlaps_are_named_with_the_pair_and_the_remedy():
    _, (text,) = load(KEYS, overlaps="keep")
    lines = text.splitlines()
    # Boxes of 0.2 m whose centres are 0.102 m apart; the box is 2 mm in the floor.
    assert "  jammed: low and high by 98.00 mm, and 1 more" in lines
    assert "  #2: floor and low by 20.00 mm" in lines
    assert "change the qpos of the keyframe" in text
    assert not [line for line in lines if line.startswith(("  apart", "  flat"))]  # 0.5 mm is not deep.


def test_a_keyframe_with_an_overlap_that_is_named_sets_deep():
    sim = stepper.Stepper(stepper.load(KEYS))
    flags = []
    for key in range(4):
        sim.reset(keyframe=key)
        sim.step()
        flags.append(bool(stepper.Status(sim.status) & stepper.Status.DEEP))
    assert flags == [False, True, True, False]


def test_the_command_explain_lists_overlaps_of_keyframes(tmp_path, capsys):
    (tmp_path / "keys.xml").write_text(KEYS)
    explain(str(tmp_path / "keys.xml"))
    told = capsys.readouterr().out
    assert (
        "Overlaps of more than 1 mm in keyframes:\n  jammed: low and high by 98.00 mm, and 1 more\n  #2: floor and low by 20.00 mm\n"
        in told
    )
    (tmp_path / "keys.xml").write_text(KEYS.partition("<keyframe>")[0] + "</mujoco>")
    explain(str(tmp_path / "keys.xml"))
    assert capsys.readouterr().out.endswith("Overlaps of more than 1 mm in keyframes:\n  nothing\n")


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(0.0, 0.5), st.floats(-20.0, 20.0))
def test_overlaps_of_a_keyframe_are_those_of_its_joint_angles(angle, height, speed):
    """The depth in the floor is that of geometry, to the digits of the message, at every angle and speed."""
    key = f'<key name="k" qpos="0 0 {height!r} 1 0 0 0 {angle!r}" qvel="0 0 {speed!r} 0 0 0 0"/>'
    with warnings.catch_warnings(record=True, action="always") as found:
        stepper.load(LEG.format(keys=key))
    depth = 1e3 * max(0.1 - height, 0.03 - (height - 0.4 * math.cos(angle)))
    if depth > 1.01:
        # Half of the last digit of the message, and 20 m/s times the trial step of 1 ns.
        assert abs(float(re.search(r"k: floor and \w+ by ([\d.]+) mm", str(found[0].message))[1]) - depth) < 0.00501
    elif depth < 0.99:
        assert not found


# Meshes that collide as a convex hull much larger than they are are named, with the remedy.

VALLEY = sheet([[1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
BALL = '<body pos="0 0 2"><freejoint/><geom size=".2" mass="1"/></body>'


def scene(mesh, body=BALL, inertia="shell"):
    vertices, faces = mesh
    asset = f'<asset><mesh name="m" inertia="{inertia}" vertex="{vertices}" face="{faces}"/></asset>'
    return f'<mujoco>{asset}<worldbody><geom name="ground" type="mesh" mesh="m"/>{body}</worldbody></mujoco>'


def faces_of(*boxes):
    """Closed mesh of boxes (lows, highs), each of twelve triangles seen from outside."""
    corners = [[(high if k >> i & 1 else low)[i] for i in range(3)] for low, high in boxes for k in range(8)]
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [f"{8 * n + a} {8 * n + b} {8 * n + c}  {8 * n + a} {8 * n + c} {8 * n + d}" for n in range(len(boxes)) for a, b, c, d in sides]
    return "  ".join(f"{x} {y} {z}" for x, y, z in corners), "  ".join(faces)


def ratio(mesh):
    """Of the hull's volume to that of the mesh as reported; 1 where it is not worth a line."""
    found = load(scene(mesh), overlaps="keep")[0].wide_hulls
    return found[0][1] if found else 1.0


def test_a_ball_rests_above_a_valley_and_the_warning_says_why():
    model, (message,) = load(scene(VALLEY), overlaps="keep")
    assert model.wide_hulls == [(0, math.inf)]
    assert "ground: more than 100 times" in message
    assert "geom_concave" in message
    assert "ground collides as the convex hull of its mesh" in model.explain()
    sim = simulate(model, steps=1000)
    assert sim.qpos[2] == pytest.approx(1.2, abs=1e-3)  # On the lid: 1 m and the radius; the slop is 1e-5 m.
    concave = model.replace(geom_concave=[1, 0])
    assert concave.wide_hulls == []
    assert "geom_concave=" not in concave.explain().split("Convex hulls larger than their mesh")[1]
    sim = simulate(concave, steps=1000)
    assert sim.qpos[2] < 0.5  # In the valley: 0.2 sqrt(2) = 0.28 m at rest.


def test_a_saved_model_reports_them_and_does_not_warn_again(tmp_path):
    model, _ = load(scene(VALLEY), overlaps="keep")
    model.save(tmp_path / "valley")
    again, messages = load(tmp_path / "valley", overlaps="keep")
    assert again.wide_hulls == model.wide_hulls
    assert messages == []


@pytest.mark.parametrize("closed", [True, False])
def test_convex_solids_and_shells_are_right(closed):
    vertices, faces = faces_of(([-1, -1, -1], [1, 1, 1]))
    # Without its lid and its floor it is a tube of sheets: from outside, where its surface looks, it is the box.
    assert load(scene((vertices, faces if closed else "  ".join(faces.split("  ")[4:]))), overlaps="keep")[0].wide_hulls == []


def test_hills_are_right():
    """A dome of a height field's grid: its hull is the dome, with a floor."""
    heights = [[2 - (x * x + y * y) / 9 for x in range(-3, 4)] for y in range(-3, 4)]
    assert load(scene(sheet(heights)), overlaps="keep")[0].wide_hulls == []


def test_nothing_gets_into_a_casing():
    """A box of six thick walls is hollow, and closed."""
    walls = [
        ([-1 if j != i else s * 1 - 0.05 for j in range(3)], [1 if j != i else s * 1 + 0.05 for j in range(3)])
        for i in range(3)
        for s in (-1, 1)
    ]
    assert load(scene(faces_of(*walls)), overlaps="keep")[0].wide_hulls == []


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
    model, (message,) = load(scene(trench), overlaps="keep")
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
        _, messages = load(moving, overlaps="keep")
        assert bool(messages) == told
        assert all("#1 of body b: more than 100 times" in message for message in messages)


def test_what_is_drawn_alone_is_not_measured():
    text = scene(VALLEY).replace('name="ground"', 'name="ground" contype="0" conaffinity="0"')
    assert load(text, overlaps="keep") == (stepper.load(text), [])


def test_boxes_and_height_fields_have_no_hull():
    field = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 1 0"/></asset>'
    model = stepper.load(f'<mujoco>{field}<worldbody><geom type="hfield" hfield="h"/>{BALL}</worldbody></mujoco>')
    assert model.wide_hulls == []
    assert np.all(model.geom_concave == 0)
