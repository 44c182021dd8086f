"""Heights under places are where MuJoCo's rays meet the field."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from models import SOURCES, stepper_model
from stepper.sensors import HeightField


def scene(turn=30.0, rows=7, columns=11):
    hills = " ".join(f"{x:.6f}" for x in np.random.default_rng(2).uniform(0, 1, rows * columns))
    return f"""<mujoco><asset><hfield name="hills" nrow="{rows}" ncol="{columns}" size="2 1.5 .4 .1" elevation="{hills}"/></asset>
      <worldbody><geom name="ground" type="hfield" hfield="hills" pos=".3 -.2 .15" euler="0 0 {turn}"/>
      <geom name="floor" type="plane" size="1 1 1" pos="0 0 -9"/>
      <body name="base" pos=".1 .2 2"><freejoint/><geom name="ball" size=".05"/></body></worldbody></mujoco>"""


def downwards(m, data, x, y):
    """Height at which a ray of MuJoCo's from above meets the ground."""
    geom = np.array([-1], np.int32)
    far = mujoco.mj_ray(m, data, np.array([x, y, 5.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom, None)
    return 5.0 - far, geom[0]


def test_heights_are_where_mujocos_rays_meet_the_field():
    m = mujoco.MjModel.from_xml_string(scene())
    data = mujoco.MjData(m)
    data.qpos[:3] = 50.0
    mujoco.mj_forward(m, data)
    model = stepper.load(scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 3)
    places = np.random.default_rng(0).uniform(-1.2, 1.2, (3, 200, 2))
    found = ground.heights(sim, places)
    assert found.shape == (3, 200)
    inside = 0
    for k in range(3):
        for (x, y), height in zip(places[k], found[k], strict=True):
            expected, geom = downwards(m, data, x, y)
            if geom == 0:  # Beyond the border the ray meets the floor.
                inside += 1
                assert height == pytest.approx(expected, abs=1e-9)
            else:
                assert np.isnan(height)
    assert inside > 500
    np.testing.assert_array_equal(ground.heights(sim, places[0]), np.broadcast_to(found[0], (3, 200)))
    assert (ground.heights(sim, [[40.0, 0.0]], beyond=-1.0) == -1.0).all()


def test_a_scan_turns_with_the_body():
    model = stepper.load(scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 2)
    half = np.array([0.0, 0.6])
    quats = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    sim.reset(qpos=np.hstack([[[0.1, 0.2, 2.0], [-0.3, 0.1, 1.0]], quats]))
    offsets = np.array([[0.4, 0.0], [0.0, 0.3], [-0.2, -0.1]])
    found = ground.scan(sim, "base", offsets)
    c, s = np.cos(1.2), np.sin(1.2)
    turned = offsets @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(found[0], ground.heights(sim, offsets + np.array([0.1, 0.2]))[0], rtol=1e-12)
    np.testing.assert_allclose(found[1], ground.heights(sim, turned + np.array([-0.3, 0.1]))[1], rtol=1e-12)
    assert HeightField(model, "ground").scan(stepper.Stepper(model), 1, offsets).shape == (3,)


def test_an_environments_own_place_of_the_field_counts():
    model = stepper.load(scene(turn=0.0))
    ground, sim = HeightField(model, 0), stepper.Stepper(model, 2)
    pos = np.tile(model.geom_pos, (2, 1, 1))
    pos[1, 0] += [0.25, 0.1, 0.5]
    sim.randomize(geom_pos=pos)
    places = np.array([[[0.3, 0.1]], [[0.55, 0.2]]])
    heights = ground.heights(sim, places)
    assert heights[1] == pytest.approx(heights[0] + 0.5, abs=1e-12)


def plain(top, half, x, y):
    """Height at one place, of the triangle that it lies in."""
    rows, columns = top.shape
    u, v = (x + half[0]) / (2 * half[0]) * (columns - 1), (y + half[1]) / (2 * half[1]) * (rows - 1)
    if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
        return np.nan
    c, r = min(int(u), columns - 2), min(int(v), rows - 2)
    a, b = u - c, v - r
    low, high, corner = top[r, c], top[r + 1, c + 1], top[r, c + 1] if a >= b else top[r + 1, c]
    return low + max(a, b) * (corner - low) + min(a, b) * (high - corner)


@settings(deadline=None)
@given(st.integers(2, 6), st.integers(2, 6), st.integers(0, 2**32), st.tuples(st.floats(0.1, 9.0), st.floats(0.1, 9.0)))
def test_heights_are_those_of_the_triangles(rows, columns, seed, half):
    rng = np.random.default_rng(seed)
    top, half = rng.uniform(-1, 1, (rows, columns)), np.array(half)
    places = rng.uniform(-1.2, 1.2, (3, 40, 2)) * half
    found = HeightField.from_elevation(top, half).heights(None, places)
    expected = np.array([plain(top, half, x, y) for x, y in places.reshape(-1, 2)]).reshape(3, 40)
    # Ten operations of rounding error, of numbers up to 10.
    np.testing.assert_allclose(found, expected, atol=1e-13)


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(0, 300), st.integers(0, 2**32), st.floats(-3.0, 3.0))
def test_scans_are_heights_of_turned_offsets_in_any_batch(n, k, seed, angle):
    """Rows do not depend on the others: a batch has the bits of its robots one by one. Some of the places are beyond the border."""
    rng = np.random.default_rng(seed)
    ground = HeightField.from_elevation(rng.uniform(-1, 1, (20, 30)), (3.0, 2.0), pos=(0.5, -0.2, 0.1), angle=angle)
    places, angles, offsets = rng.uniform(-3, 3, (n, 2)), rng.uniform(-4, 4, n), rng.uniform(-1, 1, (k, 2))
    found = ground.around(places, angles, offsets)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y = c * offsets[:, 0] - s * offsets[:, 1], s * offsets[:, 0] + c * offsets[:, 1]
    expected = ground.heights(None, places[:, None] + np.stack([x, y], axis=-1))
    # Two ways to turn a place, each within some rounding errors of 5 m and cells of 0.2 m between heights of 2 m.
    np.testing.assert_allclose(found, expected, atol=1e-13)
    for row in range(n):
        np.testing.assert_array_equal(ground.around(places[[row]], angles[[row]], offsets)[0], found[row])
    assert (np.nan_to_num(ground.around(places, angles, offsets, beyond=-7.0), nan=99.0) != 99.0).all()


def test_heights_without_a_simulation_are_those_of_the_models_place():
    model = stepper.load(scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 3)
    places = np.random.default_rng(3).uniform(-1.5, 1.5, (3, 50, 2))
    np.testing.assert_array_equal(ground.heights(None, places), ground.heights(sim, places))
    pos = np.array(model.geom(0).pos)
    angle = np.radians(30.0)
    same = HeightField.from_elevation(ground.elevation, ground.half, pos=pos, angle=angle)
    np.testing.assert_allclose(same.heights(None, places), ground.heights(None, places), atol=1e-13)


def test_a_field_that_a_moving_body_carries_is_refused():
    """Also where the geom's own body has no joint."""
    xml = scene().replace('<geom name="ground"', '<body><freejoint/><geom size=".1"/><body><geom name="ground"')
    xml = xml.replace('euler="0 0 30.0"/>', 'euler="0 0 30.0"/></body></body>')
    with pytest.raises(ValueError, match="is inclined or on a joint"):
        HeightField(stepper.load(xml), "ground")


def test_a_field_of_a_package_is_read():
    """dm_control's quadruped escapes over a field."""
    model = stepper_model("dm_control/quadruped", strict=False)
    fields = [k for k in range(model.ngeom) if model.geom(k).type == "hfield"]
    if not fields:
        pytest.skip("its file has no height field")
    m = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/quadruped"]))
    ground = HeightField(model, fields[0], source=str(SOURCES["dm_control/quadruped"]))
    assert ground.elevation.shape == (m.hfield_nrow[0], m.hfield_ncol[0])
    np.testing.assert_array_equal(ground.half, m.hfield_size[0, :2])


@pytest.mark.parametrize(("call", "said"), [
    (lambda model: HeightField(model, "ball"), "geom 'ball' is a sphere, must be a height field"),
    (lambda model: HeightField(model, "ground", source="<mujoco/>"), "the source belongs to another model"),
    (lambda model: HeightField(model, 0).heights(stepper.Stepper(model, 2), np.zeros((3, 4, 2))), r"places has shape \(3, 4, 2\)"),
    (lambda model: HeightField(model, "ground").scan(stepper.Stepper(model, 2), 1, np.zeros(2)), r"offsets has shape \(2,\)"),
    (lambda model: HeightField.from_elevation(np.zeros((1, 5)), (1, 1)), r"elevation has shape \(1, 5\)"),
    (lambda model: HeightField.from_elevation(np.zeros((2, 5)), (1, 0)), "half is"),
    (lambda model: HeightField(model, "ground").around(np.zeros((2, 2)), np.zeros(3), np.zeros((1, 2))), r"places has shape \(2, 2\)"),
    (lambda model: HeightField.from_elevation([["a"]], (1, 1)), r"elevation is \[\['a'\]\], must be an array of numbers"),
    (lambda model: HeightField(model, "ground").heights(None, "here"), "places is 'here', must be an array of numbers"),
    (lambda model: HeightField(model, "ground").heights(None, 1.0), r"places has shape \(\)"),
    (lambda model: HeightField(stepper.load(scene().replace('euler="0 0 30.0"', 'euler="20 0 0"')), "ground"), "is inclined"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, said):
    with pytest.raises((TypeError, ValueError), match=said):
        call(stepper.load(scene()))


def test_a_model_whose_source_is_not_known_asks_for_it(tmp_path: Path):
    import subprocess
    import sys

    stepper.load(scene()).save(tmp_path / "hills.stepper")
    code = "import sys, stepper; m = stepper.load(sys.argv[1]); stepper.sensors.HeightField(m, 'ground')"
    ended = subprocess.run([sys.executable, "-c", code, str(tmp_path / "hills.stepper")], capture_output=True, text=True, check=False)
    assert "pass source=" in ended.stderr
