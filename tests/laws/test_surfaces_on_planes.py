"""Concave meshes on planes and height fields: what rests does not fall."""

import numpy as np
import pytest
import stepper

PYRAMID = 'vertex="-.1 -.1 0 .1 -.1 0 .1 .1 0 -.1 .1 0 0 0 .1" face="0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"'  # a square base and four sides


@pytest.mark.parametrize("concave", [False, True])
@pytest.mark.parametrize("joint", ["<freejoint/>", '<joint type="slide" axis="0 0 1"/>'])
def test_a_mesh_that_does_not_rotate_stays_on_a_plane(joint, concave):
    """Without rotation a plane's infinite size must not spoil the bound on the approach: 0 times infinity is NaN."""
    model = stepper.load(f"""
    <mujoco><option timestep=".005"/><asset><mesh name="pyramid" {PYRAMID}/></asset><worldbody>
      <geom type="plane" size="5 5 .1"/>
      <body pos="0 0 .1">{joint}<inertial pos="0 0 .03" mass="1" diaginertia=".01 .01 .01"/><geom type="mesh" mesh="pyramid"/></body>
    </worldbody></mujoco>""")
    sim = stepper.Stepper(model.replace(geom_concave=[False, concave]), 2)
    for _ in range(100):
        sim.step()
    height = sim.qpos[:, 2] if "free" in joint else sim.qpos[:, 0] + 0.1
    np.testing.assert_allclose(height, 0.0, atol=1e-6)  # of 1 m after a fall of 0.5 s
    assert not np.any(sim.status)
