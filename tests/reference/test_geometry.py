"""Distances and normals of every pair of shapes against MuJoCo's, meshes and height fields included."""

import mujoco
import numpy as np
import pytest
from models import random_quaternion, simulate

SHAPES = {
    "sphere": 'type="sphere" size="0.2"',
    "capsule": 'type="capsule" size="0.12 0.2"',
    "cylinder": 'type="cylinder" size="0.15 0.2"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.2 0.3"',
    "box": 'type="box" size="0.1 0.2 0.15"',
    "mesh": 'type="mesh" mesh="rock"',
}
PAIRS = [(a, b) for i, a in enumerate(SHAPES) for b in list(SHAPES)[i:]]
MARGIN = 0.5  # m of each geom: contacts are found, and can be read, at that distance.
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
      <worldbody>{body.format(SHAPES[a], MARGIN)}{body.format(SHAPES[b], MARGIN)}</worldbody>
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
        assert nearest["distance"] + 2 * MARGIN == pytest.approx(expected, abs=TOLERANCE)
        # Points where the line between the nearest points is ill-defined differ by the root of the tolerance.
        normal = (line[3:] - line[:3]) / expected
        sign = 1.0 if tuple(nearest["geom"]) == (0, 1) else -1.0
        assert sign * np.array(nearest["normal"]) == pytest.approx(normal, abs=1e-4 / np.sqrt(expected))
    assert compared > 10


HILLS = """
<mujoco>
  <option gravity="0 0 0" timestep="1e-9" ccd_tolerance="1e-12" ccd_iterations="500"/>
  <asset><hfield name="hills" nrow="7" ncol="9" size="1 0.8 0.3 0.1"/></asset>
  <worldbody>
    <geom type="hfield" hfield="hills" margin="0.06" pos="0.1 0.2 0.3" euler="0 0 20"/>
    <body><freejoint/><geom type="sphere" size="0.05" margin="0.06"/></body>
  </worldbody>
</mujoco>
"""


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
