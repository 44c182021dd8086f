"""The motion does not depend on where the scene stands, which way it faces, its mirror image, or the order of its bodies."""

import numpy as np
import pytest
from heaps import Heap, heap
from models import simulate
from rotations import about, matrix, product

# Solved far below what is compared, so that only rounding is left of the order in which contacts are visited.
SETTINGS = {"timestep": 2e-3, "iterations": 20_000, "tolerance": 1e-13}
STEPS = 150
SHAPES = [("sphere", 0.1, 1.0), ("capsule", 0.08, 0.5), ("sphere", 0.12, 2.0), ("capsule", 0.1, 1.5)]
TILT = 0.1  # rad, of the floor about the y axis: heaps slide and roll.


def end_of(scene: Heap, qpos=None, qvel=None, *, order=None, floor: np.ndarray | None = None, origin=(0, 0, 0), **options):
    """The state after some steps on a tilted floor, (n, 7) and (n, 6); contacts have acted."""
    tilt = about([0, 1, 0], TILT) if floor is None else floor
    text = scene.xml(order, 'pos="{} {} {}" quat="{} {} {} {}"'.format(*origin, *tilt.tolist()))
    sim = simulate(text, **(SETTINGS | options))
    sim.set_state((scene.qpos if qpos is None else qpos).ravel(), (scene.qvel if qvel is None else qvel).ravel())
    force = 0.0
    for _ in range(STEPS):
        sim.step()
        force += sim.contacts()["force"].sum()
    assert force > 0
    assert sim.residual < 1e-12
    return sim.qpos.reshape(-1, 7), sim.qvel.reshape(-1, 6)


@pytest.fixture(scope="module", params=["euler", "midpoint"])
def case(request):
    """Balls and capsules that strike each other and the floor, and how they end."""
    scene = heap(SHAPES, 0.6, seed=5, spacing=0.24)
    return scene, request.param, end_of(scene, integrator=request.param)


# Rounding (1e-16) grows by the strikes: each multiplies a difference by about distance over radius, three to five here, a few in a row.
CLOSE = 1e-9


def assert_same(found, expected):
    assert np.abs(found[0] - expected[0]).max() < CLOSE
    assert np.abs(found[1] - expected[1]).max() < 100 * CLOSE


def test_turning_about_the_vertical(case):
    """Everything turned by 1 rad and moved: the end is turned and moved."""
    scene, integrator, (qpos, qvel) = case
    turn, origin = about([0, 0, 1], 1.0), np.array([3.0, -2.0, 1.0])

    def move(q, v):
        q, v = q.copy(), v.copy()
        q[:, :3] = q[:, :3] @ matrix(turn).T + origin
        q[:, 3:] = [product(turn, quat) for quat in q[:, 3:]]
        v[:, :3] = v[:, :3] @ matrix(turn).T
        return q, v

    floor = product(turn, about([0, 1, 0], TILT))
    found = end_of(scene, *move(scene.qpos, scene.qvel), floor=floor, origin=origin.tolist(), integrator=integrator)
    assert_same(found, move(qpos, qvel))


def test_mirror_image(case):
    """Reflected in the x-z plane: velocities change the sign of y, rotations of x and z."""
    scene, integrator, (qpos, qvel) = case
    signs = np.array([1, -1, 1, 1, -1, 1, -1]), np.array([1, -1, 1, -1, 1, -1])
    found = end_of(scene, scene.qpos * signs[0], scene.qvel * signs[1], integrator=integrator)
    assert_same(found, (qpos * signs[0], qvel * signs[1]))


@pytest.mark.parametrize("order", [[3, 2, 1, 0], [1, 3, 0, 2]])
def test_bodies_declared_in_another_order(case, order):
    scene, integrator, (qpos, qvel) = case
    found = end_of(scene, scene.qpos[order], scene.qvel[order], order=order, integrator=integrator)
    assert_same(found, (qpos[order], qvel[order]))
