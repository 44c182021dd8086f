"""Tumbling rocks: what the search for their normals keeps of the last step is the environment's own, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import stepper


@pytest.mark.parametrize("thickness", [1.0, 1e-2, 3e-4, 1e-4, 1e-5, 1e-6, 1e-8, 1e-12])
def test_a_hull_of_any_thickness_lies_on_the_floor(thickness):
    points = np.random.default_rng(0).uniform(-1, 1, (250, 3)) * [thickness, 1, 1]
    vertices = " ".join(map(repr, points.ravel().tolist()))
    sim = stepper.Stepper(
        stepper.load(f"""
    <mujoco>
      <asset><mesh name="leaf" vertex="{vertices}"/></asset>
      <worldbody>
        <geom type="plane" size="1 1 1"/>
        <body euler="0 90 0" pos="0 0 {thickness + 0.01}"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".5 .3 .3"/>
          <geom type="mesh" mesh="leaf"/></body>
      </worldbody>
    </mujoco>""")
    )
    sim.step(nstep=1000)
    assert not sim.status
    assert len(sim.contacts()) >= 3
    # It lies on its flat side, its centre no further from the floor than it is thick, up to MuJoCo's vertices in single precision.
    assert abs(sim.qpos[2]) < thickness + 1e-5
    assert np.abs(sim.qvel).max() < 1e-3
