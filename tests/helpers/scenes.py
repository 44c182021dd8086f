"""Scenes: settings that a user may choose, bodies on a plane, bodies that begin within one another, and bodies thrown on a floor."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import strategies as st
from models import random_quaternion

G = 9.81
DTS = [1e-4, 1e-3, 5e-3, 2e-2]
CHOICES = [{"integrator": i, "stabilization": s} for i in ("euler", "midpoint") for s in ("baumgarte", "split")]

every_dt = pytest.mark.parametrize("dt", DTS)
every_choice = pytest.mark.parametrize("choice", CHOICES, ids=lambda c: "-".join(c.values()))
BOX = 'type="box" size=".2 .15 .05" mass="1.3"'


OVERLAP = """<mujoco><worldbody><geom name="wall" size=".05"/><body><joint {joint}/>
<geom name="rod" type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody></mujoco>"""
"""Rod whose contact has a normal that passes through its joint, with the attributes of the joint as a field."""

SLOT = """<mujoco><option gravity="0 0 0"/><worldbody>
<geom name="right" type="box" size=".05 .1 .1" pos=".15 0 0"/><geom name="left" type="box" size=".05 .1 .1" pos="-.15 0 0"/>
<body><joint type="slide" axis="1 0 0"/><geom name="block" type="box" size="{half} .05 .05"/></body></worldbody></mujoco>"""
"""Block on a slide in a slot of the half width 0.1 m, with its half width in m as a field."""
GEOMS = {
    # Boxes meet the floor only: there is no kernel for them among themselves yet.
    "sphere": 'type="sphere" size="{0}"',
    "capsule": 'type="capsule" size="{0} {0}"',
    "box": 'type="box" size="{0} {0} {0}" contype="2" conaffinity="0"',
}
REACH = {"sphere": 1.0, "capsule": 2.0, "box": 3**0.5}
"""Distance of a shape's farthest point from its centre, in sizes."""


def on_plane(geom: str, friction: float, height: float, slope: float = 0.0) -> str:
    """A body with one geom that touches a plane inclined about the y axis (rad), downhill towards +x; height is from plane to centre."""
    x, z = (float(height * part) for part in (np.sin(slope), np.cos(slope)))
    return f"""<mujoco><compiler angle="radian"/><option gravity="0 0 -{G}"/><default><geom friction="{friction} 0 0"/></default>
      <worldbody><geom type="plane" size="0 0 1" euler="0 {slope} 0"/>
      <body pos="{x} 0 {z}" euler="0 {slope} 0"><freejoint/><geom {geom}/></body></worldbody></mujoco>"""


def arms(seed: int) -> str:
    """Two chains of two to four boxes on hinges in any direction, a quarter of a metre apart, with damping."""
    rng = np.random.default_rng(seed)
    links, chains = rng.integers(2, 5), ""
    for x in (-0.12, 0.12):
        chain = ""
        for k in range(links):
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            size = rng.uniform(0.03, 0.08, 3)
            pos = np.array([x, 0, 0.5]) if k == 0 else rng.uniform(-0.08, 0.08, 3) + np.array([0, 0, 0.08])
            angles = rng.uniform(-180, 180, 3)
            if k == 0:
                pos = pos + rng.uniform(-0.05, 0.05, 3)
            at = rng.uniform(-0.05, 0.05, 3)
            chain += (
                f'<body pos="{_text(pos)}"><joint axis="{_text(axis)}" damping=".1"/><geom type="box" size="{_text(size)}" '
                f'pos="{_text(at)}" euler="{_text(angles)}" mass="{rng.uniform(0.2, 2)}"/>'
            )
        chains += chain + "</body>" * links
    return f'<mujoco><option timestep=".002"/><worldbody>{chains}</worldbody></mujoco>'


def _text(numbers: np.ndarray) -> str:
    return " ".join(map(str, numbers))


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
