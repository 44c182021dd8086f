"""Contacts of two geoms in random poses are MuJoCo's where the definitions agree. test_geometry.py compares distances."""

import mujoco
import numpy as np
import pytest
from models import random_quaternion, simulate

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
    """Whether the first geom's centre line (a capsule's; a ball's is a point) enters the second, a box or cylinder.

    MuJoCo then finds a way out that is not the shortest, or none at all: a capsule through a box is 0.019 m apart by `mj_geomDistance`.
    """
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
    sim = simulate(model, len(qpos), timestep=1e-9)
    sim.set_state(qpos=qpos)
    sim.step()
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
