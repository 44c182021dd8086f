"""Shapes at rest on one another carry their weight, and heaps do not sink in."""

import numpy as np
import pytest
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
