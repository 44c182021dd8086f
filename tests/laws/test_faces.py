"""Faces that lie on one another touch with their area, in both precisions and however they are turned."""

import numpy as np
import pytest
import stepper
from models import random_quaternion
from rotations import about, matrix, product
from stepper import Options

HALF = np.array([0.05, 0.04, 0.02])
"""m: of the lower box; the upper one is half as wide."""
MJCF = f"""<mujoco><option gravity="0 0 0"/><worldbody>
  <body><freejoint/><geom type="box" size="{HALF[0]} {HALF[1]} {HALF[2]}" mass="1"/></body>
  <body><freejoint/><geom type="box" size="{HALF[0] / 2} {HALF[1] / 2} {HALF[2]}" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_box_that_lies_on_a_box_touches_it_with_four_corners(precision):
    rng, n = np.random.default_rng(0), 256
    qpos, qvel = np.zeros((n, 14)), np.zeros((n, 12))
    for q, v in zip(qpos, qvel, strict=True):
        quat = random_quaternion(rng)
        q[3:7], q[10:] = quat, product(quat, about([0, 0, 1], rng.uniform(-0.3, 0.3)))
        q[7:10] = matrix(quat) @ [0.01, -0.005, 2 * HALF[2]]
        v[6:9] = -0.1 * matrix(quat)[:, 2]
    sim = stepper.Stepper(stepper.load(MJCF), n, options=Options(timestep=1e-3), precision=precision)
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step()
    counts = np.bincount(sim.contacts()["env"], minlength=n)
    assert (counts == 4).all(), f"{np.count_nonzero(counts != 4)} of {n} boxes touch with {np.unique(counts)} points"
