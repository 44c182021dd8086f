"""A box in a square hole of a concave mesh: it slides down along the walls, whatever touches."""

from functools import cache

import numpy as np
import pytest
import stepper
from hypothesis import given
from hypothesis import strategies as st

PEG, HEIGHT, DEPTH, OUTER = 0.02, 0.04, 0.05, 0.06
"""Half width and half height of the peg, depth of the hole, half width of the block, m."""


def block(hole: float) -> tuple[list, list]:
    """Vertices and faces of a square block with a square hole of a half width through it; its top is at z = 0."""
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    vertices = [(half * x, half * y, z) for z in (0.0, -DEPTH) for half in (OUTER, hole) for x, y in square]
    faces = []
    for k in range(4):
        n = (k + 1) % 4
        top, bottom = ([k, n, 4 + n, 4 + k], [12 + k, 12 + n, 8 + n, 8 + k])
        for a, b, c, d in (top, bottom, [8 + k, 8 + n, n, k], [4 + k, 4 + n, 12 + n, 12 + k]):
            faces += [(a, b, c), (a, c, d)]
    return vertices, faces


@cache
def model(clearance: float, friction: float = 0.1, timestep: float = 5e-3) -> stepper.Model:
    """The block over a floor, and a peg with this much room on each side."""
    vertices, faces = block(PEG + clearance)
    numbers = [" ".join(repr(float(x)) for v in vertices for x in v), " ".join(str(k) for f in faces for k in f)]
    text = f"""<mujoco><option timestep="{timestep}"/><asset><mesh name="block" vertex="{numbers[0]}" face="{numbers[1]}"/></asset>
      <default><geom friction="{friction}"/></default><worldbody><geom type="plane" size="2 2 1" pos="0 0 {-DEPTH}"/>
      <geom type="mesh" mesh="block"/><body pos="0 0 .02"><freejoint/>
      <geom type="box" size="{PEG} {PEG} {HEIGHT}" mass=".2"/></body></worldbody></mujoco>"""
    return stepper.load(text).replace(geom_concave=[0.0, 1.0, 0.0])


@given(
    st.floats(0.0, 1e-4),
    st.floats(-1e-3, 1e-3),
    st.sampled_from([0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi]),
    st.floats(0.005, 0.03),
    st.sampled_from(["f64", "f32"]),
)
def test_a_peg_that_overlaps_a_wall_is_no_deeper_in_the_block_than_that(overlap, yaw, side, below, precision):
    """Not in the face around the hole, under which its lower end is by centimetres."""
    clearance = 1e-3
    sim = stepper.Stepper(model(clearance), precision=precision, options=stepper.Options(integrator="euler", timestep=1e-6))
    # A turned peg reaches further by the half of its side times the angle.
    reach = clearance + overlap - PEG * abs(yaw)
    qpos = [reach * np.cos(side), reach * np.sin(side), HEIGHT - below, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    sim.set_state(qpos=qpos)
    sim.step()
    # Rounding of positions of 0.05 m in 32 bits, and the cosine of the angle.
    assert sim.max_penetration <= overlap + 2e-8 + 0.5 * PEG * yaw**2


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("clearance", [1e-4, 5e-4, 1e-3])
def test_a_peg_that_slides_along_the_walls_reaches_the_floor(precision, clearance):
    """From random places in the hole, turned and pushed to a side: before, a third of them jammed at the face around the hole."""
    n, rng = 128, np.random.default_rng(0)
    sim = stepper.Stepper(model(clearance), n, precision=precision)
    qpos = np.tile(sim.model.qpos0, (n, 1))
    qpos[:, :2] += rng.uniform(-0.6, 0.6, (n, 2)) * clearance
    yaw = rng.uniform(-0.3, 0.3, n) * clearance / PEG
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    qvel = np.zeros((n, 6))
    qvel[:, :2] = rng.uniform(-0.1, 0.1, (n, 2))
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step(nstep=200)
    # On the floor to the slop of contacts.
    np.testing.assert_allclose(sim.qpos[:, 2], HEIGHT - DEPTH, atol=2e-5)


def test_a_block_of_its_size_stands_flush_on_the_mesh():
    """Its sides are in the planes of the outer walls: the corners at the edge of the top carry it all the same."""
    text = f"""<mujoco><asset><mesh name="block" vertex="{{}}" face="{{}}"/></asset><worldbody><geom type="mesh" mesh="block"/>
      <body pos="0 0 {OUTER}"><freejoint/><geom type="box" size="{OUTER} {OUTER} {OUTER}" mass="1"/></body></worldbody></mujoco>"""
    vertices, faces = block(PEG)
    text = text.format(" ".join(repr(float(x)) for v in vertices for x in v), " ".join(str(k) for f in faces for k in f))
    loaded = stepper.load(text).replace(geom_concave=[1.0, 0.0])
    for precision in ("f64", "f32"):
        sim = stepper.Stepper(loaded, precision=precision)
        sim.step(nstep=500)
        assert not sim.status
        np.testing.assert_allclose(sim.qpos[:3], [0, 0, OUTER], atol=2e-5)  # The slop of contacts.
