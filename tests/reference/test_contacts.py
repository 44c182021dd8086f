"""Contacts, distances and normals of two geoms in random poses are MuJoCo's where the definitions agree."""

import mujoco
import numpy as np
import pytest
import stepper
from geometry import about, product
from models import mjcf, random_quaternion, simulate

# m. Wide enough for every pose that is drawn: contacts are then listed at any distance, in both engines.
MARGIN = 1.0
SHAPES = {
    "plane": 'type="plane" size="0 0 1"',
    "sphere": 'type="sphere" size=".13"',
    "capsule": 'type="capsule" size=".07 .22"',
    "ellipsoid": 'type="ellipsoid" size=".1 .17 .25"',
    "cylinder": 'type="cylinder" size=".12 .2"',
    "box": 'type="box" size=".1 .2 .15"',
}
# Whose contact sets are the same; of the others only the nearest contact is. Capsule and box: MuJoCo chooses its second point by another
# rule; plane and cylinder: it puts three points on a cap, a triangle, and stepper four; plane and box: it has the first four corners.
SAME_SETS = [
    ("plane", "sphere"), ("plane", "capsule"), ("plane", "ellipsoid"), ("sphere", "sphere"), ("sphere", "capsule"), ("capsule", "capsule"),
    ("sphere", "box"), ("sphere", "cylinder"),
]  # fmt: skip
SAME_NEAREST = [("plane", "box"), ("plane", "cylinder"), ("capsule", "box")]
POSES = 200
HILLS = mjcf("hills")


def two(first: str, second: str) -> mujoco.MjModel:
    """Two geoms; both float unless the first is a plane."""
    body = '<body><freejoint/><geom name="{0}" {1} mass="1" margin="{2}"/></body>'
    still = '<geom name="a" {1} margin="{2}"/>' if first == "plane" else body
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="1e-9" gravity="0 0 0"><flag multiccd="enable"/></option><worldbody>'
        + still.format("a", SHAPES[first], MARGIN / 2)
        + body.format("b", SHAPES[second], MARGIN / 2)
        + "</worldbody></mujoco>"
    )


def poses(model, rng):
    """Near enough for the margin; apart and overlapping."""
    qpos = np.tile(model.qpos0, (POSES, 1))
    for q in qpos:
        for at in range(0, model.nq, 7):
            q[at : at + 3] = rng.uniform(-0.25, 0.25, 3) + np.array([0, 0, 0.2 if model.nq == 7 else 0.0])
            q[at + 3 : at + 7] = random_quaternion(rng)
    return qpos


def core_enters(data) -> bool:
    """Whether the first geom's centre line (a capsule's; a ball's is a point) enters the second, a box or cylinder."""
    # MuJoCo then finds a way out that is not the shortest, or none at all: a capsule through a box is 0.019 m apart by `mj_geomDistance`.
    half = data.model.geom_size[0, 1] if data.model.geom_type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
    points = data.geom_xpos[0] + np.linspace(-half, half, 2001)[:, None] * data.geom_xmat[0].reshape(3, 3)[:, 2]
    x = np.abs((points - data.geom_xpos[1]) @ data.geom_xmat[1].reshape(3, 3))
    size = data.model.geom_size[1]
    if data.model.geom_type[1] == mujoco.mjtGeom.mjGEOM_BOX:
        return (x < size).all(axis=1).any()
    is_cylinder = data.model.geom_type[1] == mujoco.mjtGeom.mjGEOM_CYLINDER
    return is_cylinder and ((np.hypot(x[:, 0], x[:, 1]) < size[0]) & (x[:, 2] < size[1])).any()


def pairs_of(model, qpos):
    """(MuJoCo's contacts, stepper's) of every pose: dist, normal and pos by row, nearest first."""
    sim = simulate(model, len(qpos), timestep=1e-9, qpos=qpos, steps=1)
    data = mujoco.MjData(model)
    for env, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        if core_enters(data):
            continue
        ours = sim.contacts(env)
        assert (ours["geom"] == [0, 1]).all()
        theirs = np.array([[c.dist, *c.frame[:3], *c.pos] for c in data.contact])
        found = np.column_stack([ours["distance"] + MARGIN, ours["normal"], ours["pos"]])
        order = [np.lexsort(np.round(x, 9).T[::-1]) for x in (theirs, found)]
        yield theirs[order[0]], found[order[1]]


@pytest.mark.parametrize(("first", "second"), SAME_SETS)
def test_contact_sets(first, second):
    model = two(first, second)
    compared = 0
    for theirs, ours in pairs_of(model, poses(model, np.random.default_rng(1))):
        compared += 1
        # Rounding of coordinates of order one, over the sine between two capsules' axes.
        np.testing.assert_allclose(ours, theirs, atol=1e-10)
    assert compared > POSES / 2


@pytest.mark.parametrize(("first", "second"), SAME_NEAREST)
def test_nearest_contact(first, second):
    model = two(first, second)
    compared = 0
    for theirs, ours in pairs_of(model, poses(model, np.random.default_rng(2))):
        compared += 1
        assert ours[0, 0] == pytest.approx(theirs[0, 0], abs=1e-10)
        # A capsule that comes near with two points at one distance has no single nearest.
        if len(ours) == 1 or ours[1, 0] > ours[0, 0] + 1e-9:
            np.testing.assert_allclose(ours[0, 1:4], theirs[0, 1:4], atol=1e-8)
    assert compared > POSES / 4


# Distances and normals of every pair of shapes against MuJoCo's, meshes and height fields included.

GEOMS = {
    "sphere": 'type="sphere" size="0.2"',
    "capsule": 'type="capsule" size="0.12 0.2"',
    "cylinder": 'type="cylinder" size="0.15 0.2"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.2 0.3"',
    "box": 'type="box" size="0.1 0.2 0.15"',
    "mesh": 'type="mesh" mesh="rock"',
}
PAIRS = [(a, b) for i, a in enumerate(GEOMS) for b in list(GEOMS)[i:]]
FAR_MARGIN = 0.5  # m of each geom: contacts are found, and can be read, at that distance.
# Of MuJoCo's iterations, set below; a thousandth of what its default would give.
TOLERANCE = 1e-8


def rock() -> str:
    """Vertices of an irregular polyhedron."""
    points = np.random.default_rng(3).normal(size=(14, 3))
    points *= 0.2 / np.linalg.norm(points, axis=1, keepdims=True)
    return " ".join(f"{x:.6f}" for x in points.ravel())


def pair(a: str, b: str) -> mujoco.MjModel:
    body = '<body><freejoint/><geom {} margin="{}" mass="1"/></body>'
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option gravity="0 0 0" timestep="1e-9" ccd_tolerance="1e-12" ccd_iterations="500"/>
      <asset><mesh name="rock" vertex="{rock()}"/></asset>
      <worldbody>{body.format(GEOMS[a], FAR_MARGIN)}{body.format(GEOMS[b], FAR_MARGIN)}</worldbody>
    </mujoco>""")


def place(model: mujoco.MjModel, qpos: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def random_pose(rng: np.random.Generator, size: float) -> np.ndarray:
    return np.concatenate([rng.uniform(-size, size, 3), random_quaternion(rng)])


@pytest.mark.parametrize(("a", "b"), PAIRS, ids=["-".join(p) for p in PAIRS])
def test_distances_are_those_of_mujoco(a, b):
    model = pair(a, b)
    sim, rng = simulate(model, integrator="euler"), np.random.default_rng(5)
    compared = 0
    for _ in range(40):
        qpos = np.concatenate([random_pose(rng, 0.35), random_pose(rng, 0.35)])
        sim.reset(qpos=qpos)
        sim.step()
        contacts, line = sim.contacts(), np.zeros(6)
        expected = mujoco.mj_geomDistance(model, place(model, qpos), 0, 1, 10.0, line)
        if not 1e-3 < expected < 0.9:
            # Overlapping shapes are compared in the Rust tests, with the least way out, which MuJoCo bounds from above.
            continue
        compared += 1
        nearest = contacts[contacts["distance"].argmin()]
        assert nearest["distance"] + 2 * FAR_MARGIN == pytest.approx(expected, abs=TOLERANCE)
        # Points where the line between the nearest points is ill-defined differ by the root of the tolerance.
        normal = (line[3:] - line[:3]) / expected
        sign = 1.0 if tuple(nearest["geom"]) == (0, 1) else -1.0
        assert sign * np.array(nearest["normal"]) == pytest.approx(normal, abs=1e-4 / np.sqrt(expected))
    assert compared > 10


def test_height_fields_are_those_of_mujoco():
    """The distance of a small ball above the surface: rows along y, the diagonal of every cell, elevation and size are read alike."""
    model = mujoco.MjModel.from_xml_string(HILLS)
    rng = np.random.default_rng(1)
    model.hfield_data[:] = rng.uniform(0, 1, model.hfield_data.size)
    sim = simulate(model, integrator="euler")
    compared = 0
    for _ in range(60):
        qpos = np.array([*rng.uniform(-0.5, 0.7, 2), rng.uniform(0.5, 0.8), 1, 0, 0, 0])
        data = place(model, qpos)
        expected = min((data.contact.dist[k] for k in range(data.ncon)), default=1.0)
        # MuJoCo keeps 50 contacts of a pair: nearer, some of the nearest triangles may be missing.
        if not 1e-4 < expected < 0.1 or data.ncon == 50:
            continue
        compared += 1
        sim.reset(qpos=qpos)
        sim.step()
        assert sim.contacts()["distance"].min() + 0.12 == pytest.approx(expected, abs=1e-6)
    assert compared > 10


# Points of two boxes of which one reaches over the edge of the other, their faces inclined a little, beside MuJoCo's.

SCENE = mjcf("overhanging_boxes")
DEPTH = 1.5e-4
"""Overlap of the faces, m."""


def overhanging_poses(aside: float, tilt: float, count: int) -> np.ndarray:
    """The box above shifted by `aside` (m), turned by up to 0.3 rad about the vertical, and inclined by `tilt` (rad): (count, 14)."""
    rng = np.random.default_rng(0)
    qpos = np.zeros((count, 14))
    qpos[:, 3] = 1.0
    for row in qpos:
        axis = rng.normal(size=2)
        turn, inclined = about([0, 0, 1], rng.uniform(-0.3, 0.3)), about([*axis / np.linalg.norm(axis), 0], tilt)
        row[7:10], row[10:] = (0.003, aside, 0.025 - DEPTH), product(inclined, turn)
    return qpos


def single(aside: float, tilt: float, count: int = 200) -> tuple[int, int]:
    """Pairs of `count` that touch in one point alone: here, and in MuJoCo."""
    qpos = overhanging_poses(aside, tilt, count)
    sim = stepper.Stepper(stepper.load(SCENE), count)
    sim.reset(qpos=qpos)
    sim.step()
    ours = np.bincount(sim.contacts()["env"], minlength=count)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, theirs = mujoco.MjData(model), np.zeros(count, dtype=int)
    for env in range(count):
        data.qpos[:] = qpos[env]
        mujoco.mj_forward(model, data)
        theirs[env] = data.ncon
    assert ours.min() >= 1
    return int((ours == 1).sum()), int((theirs == 1).sum())


@pytest.mark.parametrize("tilt", [1e-6, 1e-4, 4e-4])
@pytest.mark.parametrize("aside", [0.002, 0.018])
def test_boxes_within_and_over_an_edge_touch_in_patches(aside, tilt):
    """Inclined by less than a tenth of what the faces overlap over their length: where edges cross the faces are as near all around."""
    assert single(aside, tilt) == (0, 0)


@pytest.mark.parametrize("tilt", [1e-4, 1e-3])
def test_overhanging_boxes_touch_where_mujocos_do(tilt):
    """Same normals and distances under MuJoCo's law, in every pair, to the rounding of poses."""
    qpos = overhanging_poses(0.018, tilt, 50)
    sim = stepper.Stepper(stepper.load(SCENE), len(qpos), options=stepper.Options(contact="mujoco"))
    sim.reset(qpos=qpos)
    sim.step()
    contacts = sim.contacts()
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    for env, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        own = contacts[contacts["env"] == env]
        np.testing.assert_allclose(np.abs(own["normal"] @ data.contact.frame[0, :3]), 1.0, atol=1e-14)
        np.testing.assert_allclose(np.sort(own["distance"]), np.sort(data.contact.dist), atol=1e-14)


@pytest.mark.parametrize(
    "above",
    ['type="box" size="0.021 0.021 0.021"', 'type="mesh" mesh="cube"', 'type="capsule" size="0.021 0.021" euler="0 90 0"'],
    ids=["box", "mesh", "capsule"],
)
@pytest.mark.parametrize("tilt", [1e-4, 1e-3])
def test_what_reaches_over_an_edge_touches_along_all_that_is_near(above, tilt):
    """A box, a mesh of the same shape and a lying capsule over the edge of a box: four points and two, at true distances."""
    corners = " ".join(f"{x} {y} {z}" for x in (-0.021, 0.021) for y in (-0.021, 0.021) for z in (-0.021, 0.021))
    xml = SCENE.replace("<worldbody>", f'<asset><mesh name="cube" vertex="{corners}"/></asset><worldbody>')
    xml = xml.replace('type="box" size="0.021 0.021 0.021"', above)
    qpos = overhanging_poses(0.004 if "capsule" in above else 0.018, tilt, 50)
    sim = stepper.Stepper(stepper.load(xml), len(qpos))
    sim.reset(qpos=qpos)
    sim.step()
    contacts = sim.contacts()
    assert (np.bincount(contacts["env"], minlength=len(qpos)) == (2 if "capsule" in above else 4)).all()
    # No point is deeper than the faces' overlap and what an inclination lifts over their length.
    assert (np.abs(contacts["distance"] + DEPTH) <= 0.04 * tilt).all()
