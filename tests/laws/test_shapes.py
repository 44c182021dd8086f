"""Shapes at rest on one another carry their weight; seams between triangles are not felt; a cylinder tips over its rim."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import stepper
from models import random_quaternion, simulate

G = 9.81
SHAPES = {
    "box": ('type="box" size=".1 .1 .1"', 0.1, 4),
    "cylinder": ('type="cylinder" size=".1 .1"', 0.1, 4),
    "lying cylinder": ('type="cylinder" size=".1 .1" euler="90 0 0"', 0.1, 2),
    "lying capsule": ('type="capsule" size=".1 .1" euler="90 0 0"', 0.1, 2),
    "ellipsoid": ('type="ellipsoid" size=".2 .15 .1"', 0.1, 1),
    "mesh": ('type="mesh" mesh="cube"', 0.1, 4),
}
CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
FLOORS = {
    "plane": 'type="plane" size="3 3 1"',
    "box": 'type="box" size="1 1 .5" pos="0 0 -.5"',
    "mesh": 'type="mesh" mesh="slab"',
    "hfield": 'type="hfield" hfield="flat"',
}


def scene(floor: str, geoms: list[tuple[str, float]]) -> str:
    bodies = "".join(f'<body pos="0 0 {z}"><freejoint/><geom {geom} mass="1"/></body>' for geom, z in geoms)
    slab = " ".join(f"{x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 0))
    return f"""
    <mujoco>
      <asset>
        <mesh name="cube" vertex="{CUBE}"/><mesh name="slab" vertex="{slab}"/>
        <hfield name="flat" nrow="14" ncol="11" size="1 1 .1 .1"/>
      </asset>
      <worldbody><geom {floor}/>{bodies}</worldbody>
    </mujoco>"""


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("shape", SHAPES)
def test_at_rest(shape, floor):
    geom, height, points = SHAPES[shape]
    # MuJoCo moves a mesh's frame to its centre of mass: the slab's is 0.5 m down.
    place = FLOORS[floor] + (' pos="0 0 0"' if floor == "mesh" else "")
    sim = simulate(scene(place, [(geom, height)]))
    sim.step(nstep=500)
    contacts = sim.contacts()
    assert len(contacts) == points
    assert contacts["force"][:, 0].sum() == pytest.approx(G, abs=1e-6 * G)
    assert np.abs(sim.qvel).max() < 1e-9
    assert sim.qpos[2] == pytest.approx(height, abs=sim.options.slop + 1e-6)
    assert sim.status == 0


@pytest.mark.parametrize("shape", ["box", "cylinder", "mesh"])
def test_stacks_carry_the_weight_above(shape):
    count = 5
    geom, half, _ = SHAPES[shape]
    sim = simulate(scene(FLOORS["box"], [(geom, half * (2 * i + 1)) for i in range(count)]))
    sim.step(nstep=2000)
    contacts = sim.contacts()
    for i in range(count):
        between = contacts[(contacts["body"] == [i, i + 1]).all(axis=1) | (contacts["body"] == [i + 1, i]).all(axis=1)]
        assert between["force"][:, 0].sum() == pytest.approx((count - i) * G, rel=1e-5)
    assert np.abs(sim.qvel).max() < 1e-9


@pytest.mark.parametrize("angle", np.linspace(0, np.pi / 2, 5))
def test_a_cylinder_tips_over_its_rim(angle):
    """Pushed at its centre, a cylinder as high as wide tips when the push exceeds its weight: over the rim, whatever the direction."""
    for share, falls in [(0.98, False), (1.02, True)]:
        rough = 'type="cylinder" size=".1 .1" friction="3 0 0"'
        sim = simulate(scene(FLOORS["box"], [(rough, 0.1)]))
        sim.xfrc_applied[1, :2] = share * G * np.array([np.cos(angle), np.sin(angle)])
        sim.step(nstep=400)
        assert (abs(sim.qpos[3]) < 0.99) == falls


def concave_floor(n: int) -> stepper.Model:
    """A ball and a box above a flat mesh of 2 n^2 triangles, to be taken as triangles."""
    ends = np.linspace(-1, 1, n + 1)
    vertices = np.array([[x, y, 0.0] for y in ends for x in ends] + [[0, 0, -1.0]])
    corner = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, 1:].ravel(), corner[1:, :-1].ravel()
    tip = len(vertices) - 1
    rim = np.concatenate([corner[0], corner[1:, -1], corner[-1, -2::-1], corner[-2::-1, 0]])
    sides = np.stack([rim[1:], rim[:-1], np.full(len(rim) - 1, tip)], 1)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), sides])
    text = " ".join(map(str, vertices.ravel())), " ".join(map(str, faces.ravel()))
    xml = f"""
    <mujoco>
      <asset><mesh name="floor" vertex="{text[0]}" face="{text[1]}"/></asset>
      <worldbody>
        <geom name="floor" type="mesh" mesh="floor"/>
        <body pos="-.5 0.013 .1"><freejoint/><geom type="sphere" size=".1" mass="1"/></body>
        <body pos="-.5 0.5 .05"><freejoint/><geom type="box" size=".1 .1 .05" mass="1" friction="0 0 0" priority="1"/></body>
      </worldbody>
    </mujoco>"""
    model = stepper.load(mujoco.MjModel.from_xml_string(xml))
    concave = np.array(model.geom_concave)
    concave[model.geom_names.index("floor")] = 1
    return model.replace(geom_concave=concave)


def test_seams_of_a_mesh_are_not_felt():
    """A ball rolls and a box slides over the edges between triangles: nothing slows or lifts them."""
    sim = simulate(concave_floor(16), timestep=0.002)
    qvel = np.zeros(12)
    qvel[0], qvel[4], qvel[6] = 1.0, 10.0, 1.0  # the ball rolls without slipping
    sim.reset(qvel=qvel)
    for _ in range(400):
        sim.step()
        assert abs(sim.qpos[2] - 0.1) < 1e-4 and abs(sim.qpos[9] - 0.05) < 1e-4
        assert np.abs(sim.qvel[[2, 8]]).max() < 1e-3
    assert sim.qvel[0] == pytest.approx(1.0, abs=1e-6)
    assert sim.qvel[6] == pytest.approx(1.0, abs=1e-6)


def test_a_concave_mesh_is_hollow():
    """A ball lies in a groove, where both sides carry it; the convex hull of the same mesh closes the groove."""
    depth, radius = 0.8, 0.1
    profile = [(-1, -1), (1, -1), (1, 0), (0, -depth), (-1, 0)]
    vertices = [(x, y, z) for y in (-1, 1) for x, z in profile]
    caps = [(3, 4, 0), (3, 0, 1), (3, 1, 2)]
    faces = [(a, c, b) for a, b, c in caps] + [(a + 5, b + 5, c + 5) for a, b, c in caps]
    for k in range(5):
        j = (k + 1) % 5
        faces += [(k, j, j + 5), (k, j + 5, k + 5)]
    faces = [(a, c, b) for a, b, c in faces]
    text = " ".join(map(str, np.ravel(vertices))), " ".join(map(str, np.ravel(faces)))
    xml = f"""
    <mujoco>
      <asset><mesh name="groove" vertex="{text[0]}" face="{text[1]}"/></asset>
      <worldbody>
        <geom type="mesh" mesh="groove"/>
        <body pos="0 .1 .15"><freejoint/><geom type="sphere" size="{radius}" mass="1"/></body>
      </worldbody>
    </mujoco>"""
    hull = stepper.load(mujoco.MjModel.from_xml_string(xml))
    resting = {}
    for name, model in {"hull": hull, "surface": hull.replace(geom_concave=[1.0, 0.0])}.items():
        sim = simulate(model)
        sim.step(nstep=1500)
        resting[name] = sim.qpos[2], len(sim.contacts())
    # MuJoCo keeps vertices in single precision.
    assert resting["hull"] == (pytest.approx(radius, abs=2e-5), 1)
    assert resting["surface"] == (pytest.approx(radius * np.hypot(1, depth) - depth, abs=5e-5), 2)


def test_random_boxes_never_sink_into_one_another():
    """A heap of random boxes and cylinders comes to rest without overlapping by more than the slop. Friction of rolling stops the round."""
    rng = np.random.default_rng(0)
    kinds = [
        'type="box" size=".1 .07 .05" condim="6" friction=".7 .01 .005"',
        'type="cylinder" size=".06 .08" condim="6" friction=".7 .01 .005"',
        'type="ellipsoid" size=".1 .07 .05" condim="6" friction=".7 .01 .005"',
        'type="mesh" mesh="cube" condim="6" friction=".7 .01 .005"',
    ]
    geoms = [(kinds[i % 4], 0.2 + 0.25 * i) for i in range(8)]
    sim = simulate(scene('type="box" size="9 9 .5" pos="0 0 -.5"', geoms), timestep=0.002)
    qpos = sim.qpos.copy().reshape(8, 7)
    qpos[:, :2] = rng.uniform(-0.1, 0.1, (8, 2))
    qpos[:, 3:] = [random_quaternion(rng) for _ in range(8)]
    sim.reset(qpos=qpos.ravel())
    sim.step(nstep=3000)
    assert sim.qpos.reshape(8, 7)[:, 2].min() > 0.04
    assert sim.contacts()["distance"].min() > -2 * sim.options.slop - 1e-6
