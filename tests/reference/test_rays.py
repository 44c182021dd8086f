"""Rays of all environments at once meet what MuJoCo's meet: shapes, meshes and height fields, whose heights are where they meet them."""

from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from geometry import matrix
from hypothesis import given, settings, strategies as st
from models import SOURCES, forward, random_quaternion, random_state, stepper_model
from stepper.sensors import HeightField

BOUND = 1e-9
"""m: what rounding makes of scenes of some metres, rays that nearly graze included, is below 1e-10."""

SHAPES = """<mujoco><asset><hfield name="hills" nrow="9" ncol="9" size="1 .8 .3 .2" elevation="{hills}"/>
  <mesh name="wedge" vertex="0 0 0  .4 0 0  0 .5 0  .1 .1 .6  .5 .4 .1"/></asset><worldbody>
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -2" euler="5 3 0"/>
  <geom name="ground" type="hfield" hfield="hills" pos=".2 .1 -1.2" euler="4 -7 20"/>
  <body name="pill" pos="1 0 0"><freejoint/><geom name="pill" type="capsule" size=".2 .3"/></body>
  <body name="box" pos="0 1 0"><freejoint/><geom name="box" type="box" size=".3 .2 .1"/></body>
  <body name="can" pos="-1 0 0"><freejoint/><geom name="can" type="cylinder" size=".2 .3"/></body>
  <body name="egg" pos="0 -1 0"><freejoint/><geom name="egg" type="ellipsoid" size=".3 .2 .1"/></body>
  <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".2"/></body>
  <body name="stone" pos="1 1 1"><freejoint/><geom name="stone" type="mesh" mesh="wedge"/></body>
</worldbody></mujoco>"""


def scene() -> mujoco.MjModel:
    hills = np.random.default_rng(4).uniform(0, 1, 81)
    hills[:2] = 0, 1  # They are scaled to 0 and 1.
    return mujoco.MjModel.from_xml_string(SHAPES.format(hills=" ".join(f"{x:.6f}" for x in hills)))


def endless(m: mujoco.MjModel) -> mujoco.MjModel:
    """The same with planes without end, as they are for contacts and for rays here, and every geom's own frame."""
    # MuJoCo takes a frame that is nearly its body's for that, which turns a mesh of fetch's by 1e-7.
    m.geom_size[m.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE), :2] = 0.0
    m.geom_sameframe[:] = 0
    return m


def mujocos_rays(m, q, points, directions, exclude=-1):
    """Distances in m and geoms, (n,) each, of `mj_ray`, whose distances are in lengths of the direction."""
    data, geom = forward(m, q, np.zeros(m.nv)), np.array([-1], np.int32)
    found = []
    for point, direction in zip(points, directions, strict=True):
        far = mujoco.mj_ray(m, data, point, direction, None, 1, exclude, geom, None)
        found.append((far * (np.linalg.norm(direction) if far > 0 else 1.0), geom[0]))
    distances, geoms = zip(*found, strict=True)
    return np.array(distances), np.array(geoms)


def compare(m, sim, states, rays, exclude=None):
    """Distances as MuJoCo's; the same geoms, where no two are met at one distance. Returns the shares of rays that meet something."""
    sim.reset(qpos=states)
    points, directions = rays
    distances, geoms = sim.rays(points, directions, exclude=exclude)
    body = -1 if exclude is None else sim.model.body(exclude).id
    for k, q in enumerate(states):
        expected, met = mujocos_rays(m, q, points[k], directions[k], body)
        np.testing.assert_allclose(distances[k], expected, rtol=0, atol=BOUND)
        other = geoms[k] != met
        assert other.mean() < 0.01
        assert (distances[k][other] > 0).all()
    return (distances > 0).mean(), geoms


@pytest.mark.parametrize("exclude", [None, "box"])
def test_of_every_shape(exclude):
    m, rng = scene(), np.random.default_rng(1)
    sim = stepper.Stepper(stepper.load(m), 12)
    states = np.array([np.concatenate([np.r_[rng.uniform(-0.8, 0.8, 3), random_quaternion(rng)] for _ in range(6)]) for _ in range(12)])
    # From a sphere beyond all, at somewhere among them.
    points = rng.normal(size=(12, 400, 3))
    points *= 4.0 / np.linalg.norm(points, axis=-1, keepdims=True)
    points[..., 2] = np.abs(points[..., 2])
    share, geoms = compare(m, sim, states, (points, rng.uniform(-0.9, 0.9, (12, 400, 3)) - points), exclude)
    assert share > 0.5
    assert set(range(-1, 8)) - set(geoms.flat) <= {-1, 3 if exclude else -1}


def test_a_field_from_all_sides():
    """Over it, along it, at its sides and from below."""
    m = scene()
    m.geom_pos[0, 2] = -50.0
    sim, rng = stepper.Stepper(stepper.load(m), 1), np.random.default_rng(2)
    away = np.concatenate([np.r_[20.0 + 3 * k, 0, 0, 1, 0, 0, 0] for k in range(6)])
    points = rng.normal(size=(3000, 3))
    points *= 2.5 / np.linalg.norm(points, axis=-1, keepdims=True)
    at = rng.uniform(-1, 1, (3000, 3)) * [1.0, 0.8, 0.25]
    directions = at - points
    turn = np.array(forward(m, away, np.zeros(m.nv)).geom_xmat[1]).reshape(3, 3)
    # Straight down and along the grid's lines besides.
    directions[:300], directions[300:600] = [0, 0, -1.0], [1.0, 0, 0]
    points[:300], points[300:600, 0] = at[:300] + np.array([0, 0, 1.0]), -3.0
    points[300:600, 1:] = at[300:600, 1:]
    points, directions = points @ turn.T + m.geom_pos[1], directions @ turn.T
    share, geoms = compare(m, sim, away[None], (points[None], directions[None]))
    assert share > 0.7
    assert (geoms == 1).mean() > 0.6


def packaged():
    """Models of packages with meshes that can touch something, each the name and the file."""
    found = {"dm_control jaco": Path(find_spec("dm_control").submodule_search_locations[0]) / "third_party/kinova/jaco_arm.xml"}
    if robotics := find_spec("gymnasium_robotics"):
        found["gymnasium_robotics fetch"] = Path(robotics.submodule_search_locations[0]) / "envs/assets/fetch/reach.xml"
    return found


@pytest.mark.parametrize("name", packaged())
def test_of_packages_meshes(name):
    """MuJoCo's rays meet the triangles of a mesh, and so do these, though contacts meet its hull."""
    m = endless(mujoco.MjModel.from_xml_path(str(packaged()[name])))
    model, rng = stepper.load(m, strict=False), np.random.default_rng(3)
    sim = stepper.Stepper(model, 4)
    states = np.array([random_state(m, rng)[0] for _ in range(4)])
    sim.reset(qpos=states)
    # Outside of all, at the middles of geoms.
    at = np.asarray(sim.geom_xpos)[:, rng.integers(0, m.ngeom, 250)]
    away = rng.normal(size=at.shape)
    away[..., 2] = np.abs(away[..., 2])
    points = at + 4.0 * away / np.linalg.norm(away, axis=-1, keepdims=True)
    share, geoms = compare(m, sim, states, (points, at + rng.normal(scale=0.05, size=at.shape) - points))
    assert share > 0.4
    assert (m.geom_type[np.unique(geoms[geoms >= 0])] == mujoco.mjtGeom.mjGEOM_MESH).sum() >= 4


def test_range_finders_see_a_field():
    """dm_control's quadruped has twenty range finders over its terrain."""
    m = endless(mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/quadruped"])))
    finders = m.sensor_type == int(mujoco.mjtSensor.mjSENS_RANGEFINDER)
    assert finders.sum() >= 20
    model, rng = stepper.load(str(SOURCES["dm_control/quadruped"])), np.random.default_rng(6)
    assert not [line for line in model.omitted if "rangefinder" in str(line)]
    sim = stepper.Stepper(model, 8)
    states = np.array([random_state(m, rng)[0] for _ in range(8)])
    states[:, 2] += 3.0
    sim.reset(qpos=states)
    places = m.sensor_adr[finders]
    names = [m.sensor(int(k)).name for k in np.flatnonzero(finders)]
    columns = [model.sensor(name).adr for name in names]
    met = 0
    for k, q in enumerate(states):
        expected = forward(m, q, np.zeros(m.nv)).sensordata[places]
        np.testing.assert_allclose(np.asarray(sim.sensordata_ideal)[k, columns], expected, rtol=0, atol=BOUND)
        met += (expected > 0).sum()
    assert met > 30
    # The same rays asked of the batch.
    sites = [model.site(m.site(int(s)).name).id for s in m.sensor_objid[finders]]
    z = np.array([[matrix(quat)[:, 2] for quat in quats] for quats in np.asarray(sim.site_xquat)[:, sites]])
    asked, _ = sim.rays(np.asarray(sim.site_xpos)[:, sites], z, exclude=int(m.site_bodyid[m.sensor_objid[finders][0]]))
    np.testing.assert_allclose(asked, np.asarray(sim.sensordata_ideal)[:, columns], rtol=0, atol=BOUND)


def eyes() -> tuple[stepper.Model, np.ndarray]:
    """The scene with an eye in its ball that looks around, sensor "lidar", and the directions in its axes."""
    hills = " ".join(f"{x:.6f}" for x in np.r_[0, 1, np.random.default_rng(4).uniform(0, 1, 79)])
    text = SHAPES.format(hills=hills).replace('<geom name="ball" size=".2"/>', '<geom name="ball" size=".2"/><site name="eye"/>')
    rays = np.random.default_rng(7).normal(size=(60, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return stepper.load(text).with_sensors({"lidar": stepper.sensors.RayFan("eye", rays)}), rays


def crowd(num_envs, **settings):
    """Environments of that scene in states of their own."""
    model, rays = eyes()
    sim, rng = stepper.Stepper(model, num_envs, **settings), np.random.default_rng(8)
    states = np.tile(model.qpos0, (num_envs, 1))
    states[:, 28:31] = rng.uniform(-0.5, 0.5, (num_envs, 3))
    states[:, 31:35] = [random_quaternion(rng) for _ in range(num_envs)]
    sim.reset(qpos=states)
    return sim, rays


@pytest.mark.parametrize(("precision", "bound"), [("f64", 1e-12), ("f32", 1e-4)])
def test_rays_around_a_body_are_those_of_a_fan(precision, bound):
    """To rounding, which is as many times larger as the ray is longer that meets the floor far away, nearly grazing: hundreds of times."""
    sim, rays = crowd(20, precision=precision)
    found, geoms = sim.rays(np.zeros((60, 3)), 3.0 * rays, body="ball")
    assert found.dtype == {"f64": np.float64, "f32": np.float32}[precision]
    read = np.asarray(sim.read("sensordata_ideal", "lidar"))
    same = (found > 0) == (read > 0)
    assert same.mean() > 0.99
    np.testing.assert_allclose(found[same], read[same], rtol=bound, atol=bound)
    assert {sim.model.geom(name).id for name in ("ground", "stone", "floor")} <= set(geoms.flat)
    only, _ = sim.rays(np.zeros((60, 3)), 3.0 * rays, body="ball", geoms=["stone"])
    np.testing.assert_array_equal(only > 0, (only >= found) & (only > 0))
    assert ((only == found) & (only > 0)).any()


def test_axes_around_a_body():
    sim, rays = crowd(4)
    quat, pos, at = np.asarray(sim.xquat)[:, 5], np.asarray(sim.xpos)[:, 5], 0.3 * rays
    assert sim.model.body("ball").id == 5
    turn = np.array([matrix(q) for q in quat])
    x = turn[:, :, 0]
    ahead = x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1, keepdims=True)
    left = np.stack([-ahead[:, 1], ahead[:, 0], 0 * ahead[:, 0]], axis=1)
    upright = np.stack([ahead, left, np.broadcast_to([0, 0, 1.0], ahead.shape)], axis=-1)
    for axes, mats in {"body": turn, "heading": upright, "world": np.broadcast_to(np.eye(3), turn.shape)}.items():
        expected = sim.rays(at @ mats.transpose(0, 2, 1) + pos[:, None], rays @ mats.transpose(0, 2, 1), exclude=5)
        found = sim.rays(at, rays, body="ball", axes=axes)
        np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=1e-11)
        np.testing.assert_array_equal(found[1], expected[1])


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_no_bit_depends_on_who_is_beside(precision):
    """Neither on the number of environments nor on threads."""
    sim, rays = crowd(37, precision=precision, threads=1)
    points = np.asarray(sim.xpos, dtype=np.float64)[:, 5, None] + 0.4 * rays
    all_of_them, geoms = sim.rays(points, rays)
    out, out_geoms = sim.rays(points, np.broadcast_to(rays, points.shape))
    for found in (out, crowd(37, precision=precision, threads=3)[0].rays(points, rays)[0]):
        assert found.tobytes() == all_of_them.tobytes()
    assert out_geoms.tobytes() == geoms.tobytes()
    alone = stepper.Stepper(sim.model, precision=precision)
    for k in (0, 9, 36):
        alone.reset(qpos=sim.qpos[k])
        found = alone.rays(points[k], rays)
        assert found[0].tobytes() == all_of_them[k].tobytes()
        assert found[1].tobytes() == geoms[k].tobytes()


def test_an_environments_own_sizes_and_places_count():
    sim, _ = crowd(3)
    down = ([[0.0, 0.0, 5.0]], [[0.0, 0.0, -1.0]])
    qpos = np.array(sim.qpos)
    qpos[:, 28:30] = 0.0
    sim.reset(qpos=qpos)
    before, met = sim.rays(*down)
    ball, ground = sim.model.geom("ball").id, sim.model.geom("ground").id
    assert (met == ball).all()
    size, pos = np.tile(sim.model.geom_size, (3, 1, 1)), np.tile(sim.model.geom_pos, (3, 1, 1))
    size[1, ball, 0] += 0.05
    pos[2, ground, 2] += 5.5
    sim.randomize(geom_size=size, geom_pos=pos)
    after, met = sim.rays(*down)
    np.testing.assert_allclose((before - after)[:2, 0], [0.0, 0.05], atol=1e-12)
    assert met[2, 0] == ground


def test_what_begins_inside_leaves():
    """Also a field, whose base is no floor of its own for who is above it: MuJoCo's rays meet the box below the heights from inside."""
    m = scene()
    m.geom_pos[1], m.geom_quat[1], m.geom_pos[0, 2] = 0, [1, 0, 0, 0], -50.0
    sim = stepper.Stepper(stepper.load(m))
    sim.reset(qpos=np.concatenate([np.r_[20.0 + 3 * k, 0, 0, 1, 0, 0, 0] for k in range(6)]))
    distances, geoms = sim.rays([[0, 0, -0.1]] * 3 + [[26.0, 0, 0.05]], [[0, 0, -1], [0, -1, 0], [0, 0, 2.0], [1.0, 0, 0]])
    top, _ = sim.rays([[0, 0, 2.0]], [[0, 0, -1.0]])
    np.testing.assert_allclose(distances, [0.1, 0.8, 2.0 - top[0] + 0.1, 0.2], atol=1e-12)
    assert geoms.tolist() == [1, 1, 1, 4]


def test_a_mesh_that_is_only_drawn_is_no_part_of_the_model():
    text = """<mujoco><asset><mesh name="t" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>
      <geom name="drawn" type="mesh" mesh="t" contype="0" conaffinity="0"/><geom name="floor" type="plane" size="0 0 1" pos="0 0 -1"/>
      {eye}</worldbody>{sensor}</mujoco>"""
    sim = stepper.Stepper(stepper.load(text.format(eye="", sensor="")))
    assert sim.rays([[0.1, 0.1, 3]], [[0, 0, -1]])[1].tolist() == [1]
    with pytest.raises(ValueError, match='geom "drawn" is a mesh whose form the model does not have'):
        sim.rays([[0.1, 0.1, 3]], [[0, 0, -1]], geoms=["drawn"])
    # A range finder that sees it has it, as MuJoCo's.
    eye = '<body pos=".1 .1 3"><site name="eye" euler="180 0 0"/></body>'
    m = mujoco.MjModel.from_xml_string(text.format(eye=eye, sensor='<sensor><rangefinder site="eye"/></sensor>'))
    expected = forward(m, m.qpos0, np.zeros(m.nv)).sensordata
    np.testing.assert_allclose(stepper.Stepper(stepper.load(m)).sensordata_ideal, expected, atol=BOUND)
    assert 1 < expected[0] < 4


@pytest.mark.parametrize(("call", "error", "said"), [
    (lambda sim: sim.rays(np.zeros((4, 3)), np.ones((5, 3))), ValueError, r"directions has shape \(5, 3\), must be \(2, 4, 3\)"),
    (lambda sim: sim.rays(np.zeros(3), np.ones(3)), ValueError, "points has shape"),
    (lambda sim: sim.rays(np.zeros((2, 4, 3)), np.zeros((4, 3))), ValueError, r"directions\[0\] of environment 0 is \[0.0, 0.0, 0.0\]"),
    (lambda sim: sim.rays(np.full((1, 3), np.nan), np.ones((1, 3))), ValueError, r"points\[0\] of environment 0 is NaN"),
    (lambda sim: sim.rays(np.zeros((1, 3)), np.ones((1, 3)), geoms=["hill"]), KeyError, "hill"),
    (lambda sim: sim.rays(np.zeros((1, 3)), np.ones((1, 3)), exclude=99), IndexError, "99"),
    (lambda sim: sim.rays(np.zeros((1, 3)), np.ones((1, 3)), body=1, axes="up"), ValueError, "axes is 'up'"),
    (lambda sim: sim.rays(np.zeros((3, 1, 3)), np.ones((1, 3)), body=1), ValueError, r"points has shape \(3, 1, 3\)"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, error, said):
    raises(error, said, lambda: call(crowd(2)[0]))


def test_no_rays_meet_nothing():
    distances, geoms = crowd(2)[0].rays(np.zeros((0, 3)), np.zeros((2, 0, 3)))
    assert distances.shape == geoms.shape == (2, 0)


# Heights under places are where MuJoCo's rays meet the field.


def hills_scene(turn=30.0, rows=7, columns=11):
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
    m = mujoco.MjModel.from_xml_string(hills_scene())
    data = mujoco.MjData(m)
    data.qpos[:3] = 50.0
    mujoco.mj_forward(m, data)
    model = stepper.load(hills_scene())
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
    model = stepper.load(hills_scene())
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
    model = stepper.load(hills_scene(turn=0.0))
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
    model = stepper.load(hills_scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 3)
    places = np.random.default_rng(3).uniform(-1.5, 1.5, (3, 50, 2))
    np.testing.assert_array_equal(ground.heights(None, places), ground.heights(sim, places))
    pos = np.array(model.geom(0).pos)
    angle = np.radians(30.0)
    same = HeightField.from_elevation(ground.elevation, ground.half, pos=pos, angle=angle)
    np.testing.assert_allclose(same.heights(None, places), ground.heights(None, places), atol=1e-13)


def test_a_field_that_a_moving_body_carries_is_refused():
    """Also where the geom's own body has no joint."""
    xml = hills_scene().replace('<geom name="ground"', '<body><freejoint/><geom size=".1"/><body><geom name="ground"')
    xml = xml.replace('euler="0 0 30.0"/>', 'euler="0 0 30.0"/></body></body>')
    raises(ValueError, "is inclined or on a joint", lambda: HeightField(stepper.load(xml), "ground"))


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
    (lambda model: HeightField(stepper.load(hills_scene().replace('euler="0 0 30.0"', 'euler="20 0 0"')), "ground"), "is inclined"),
])  # fmt: skip
def test_wrong_calls_of_height_fields_are_errors(call, said):
    raises((TypeError, ValueError), said, lambda: call(stepper.load(hills_scene())))


def test_a_model_whose_source_is_not_known_asks_for_it(tmp_path: Path):
    import subprocess
    import sys

    stepper.load(hills_scene()).save(tmp_path / "hills.stepper")
    code = "import sys, stepper; m = stepper.load(sys.argv[1]); stepper.sensors.HeightField(m, 'ground')"
    ended = subprocess.run([sys.executable, "-c", code, str(tmp_path / "hills.stepper")], capture_output=True, text=True, check=False)
    assert "pass source=" in ended.stderr
