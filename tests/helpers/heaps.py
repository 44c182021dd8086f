"""Rigid bodies thrown on a floor: scenes for the laws that hold whatever the scene is."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from models import random_quaternion

GEOMS = {
    # Boxes meet the floor only: there is no kernel for them among themselves yet.
    "sphere": 'type="sphere" size="{0}"',
    "capsule": 'type="capsule" size="{0} {0}"',
    "box": 'type="box" size="{0} {0} {0}" contype="2" conaffinity="0"',
}


@dataclass(frozen=True)
class Heap:
    """Bodies with a start: shapes as (kind, size in m, mass in kg), coefficient of friction, qpos (n, 7), qvel (n, 6)."""

    shapes: tuple[tuple[str, float, float], ...]
    friction: float
    qpos: np.ndarray
    qvel: np.ndarray

    def xml(self, order=None, floor: str = "", gravity: str = "0 0 -9.81") -> str:
        """MJCF with the bodies in an order, on a floor with further attributes."""
        text = f'<mujoco><option gravity="{gravity}"/><default><geom friction="{self.friction} 0 0"/></default><worldbody>'
        text += f'<geom name="floor" type="plane" size="0 0 1" conaffinity="3" {floor}/>'
        for i in order if order is not None else range(len(self.shapes)):
            kind, size, mass = self.shapes[i]
            text += f'<body name="b{i}"><freejoint/><geom name="g{i}" mass="{mass}" {GEOMS[kind].format(size)}/></body>'
        return text + "</worldbody></mujoco>"


REACH = {"sphere": 1.0, "capsule": 2.0, "box": 3**0.5}
"""Distance of a shape's farthest point from its centre, in sizes."""


def heap(shapes, friction: float, seed: int, spacing: float | None = None) -> Heap:
    """Bodies in a row above the floor, thrown at random, downwards in the mean: side by side unless a spacing is given."""
    rng, n = np.random.default_rng(seed), len(shapes)
    reach = np.array([REACH[kind] * size for kind, size, _ in shapes])
    qpos, qvel = np.zeros((n, 7)), rng.normal(scale=1.5, size=(n, 6))
    qvel[:, 2] = -np.abs(qvel[:, 2])
    qpos[:, 0] = 2 * np.cumsum(reach) - reach if spacing is None else spacing * np.arange(n)
    qpos[:, 1] = rng.uniform(-0.05, 0.05, n)
    qpos[:, 2] = [0.02 + 2 * size for _, size, _ in shapes]
    qpos[:, 3:] = [random_quaternion(rng) for _ in range(n)]
    return Heap(tuple(shapes), friction, qpos, qvel)


@st.composite
def heaps(draw, kinds=tuple(GEOMS)) -> Heap:
    """One to four bodies with friction from none to more than one, and masses a hundredfold apart."""
    shape = st.tuples(st.sampled_from(kinds), st.floats(0.05, 0.15), st.floats(0.1, 10.0))
    shapes = draw(st.lists(shape, min_size=1, max_size=4))
    friction = draw(st.one_of(st.just(0.0), st.floats(0.05, 1.2)))
    return heap(shapes, friction, draw(st.integers(0, 2**16)))
