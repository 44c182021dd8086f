"""Pieces of MJCF that scenes share. SI units, radians."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

G = 9.81
"""m/s^2."""


def document(world: str, *, friction: float = 1.0, gravity: Iterable[float] = (0.0, 0.0, -G), before: str = "", after: str = "") -> str:
    """A model: what is in its world, the friction of all geoms, gravity, and further sections."""
    pull = numbers(gravity)
    return f"""<mujoco><compiler angle="radian"/><option gravity="{pull}"/><default><geom friction="{friction!r} 0 0"/></default>
      {before}<worldbody>{world}</worldbody>{after}</mujoco>"""


def numbers(values: Iterable[float]) -> str:
    """Numbers as MJCF writes them, to the last bit."""
    return " ".join(repr(float(v)) for v in values)


FLOOR = '<geom name="floor" type="plane" size="0 0 1"/>'


def free(name: str, geom: str, pos: Iterable[float], quat: Iterable[float] = (1, 0, 0, 0), inside: str = "") -> str:
    """A free body with one geom."""
    return f'<body name="{name}" pos="{numbers(pos)}" quat="{numbers(quat)}"><freejoint/><geom name="{name}" {geom}/>{inside}</body>'


def box(half: Iterable[float], mass: float) -> str:
    """Attributes of a box: half sizes in m, mass in kg."""
    return f'type="box" size="{numbers(half)}" mass="{mass!r}"'


def ball(radius: float, mass: float) -> str:
    """Attributes of a sphere."""
    return f'type="sphere" size="{radius!r}" mass="{mass!r}"'


def about_y(angle: float) -> tuple[float, float, float, float]:
    """The quaternion of a rotation about y."""
    return (math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0)


def incline(geom: str, height: float, slope: float, friction: float) -> str:
    """A body on a plane inclined about y, downhill towards +x; height from plane to centre."""
    turn = about_y(slope)
    at = (height * math.sin(slope), 0.0, height * math.cos(slope))
    plane = f'<geom name="floor" type="plane" size="0 0 1" quat="{numbers(turn)}"/>'
    return document(plane + free("body", geom, at, turn), friction=friction)


SURFACE = "surface"
"""Name of a mesh geom that is meant as its triangles, not as their hull: MJCF has no word for it."""


def surface(half: float, heights: NDArray[np.float64], kind: str) -> tuple[str, str]:
    """Assets and a geom: heights over a square of the half size (m), rows along y, as a height field ("hfield") or a mesh ("mesh").

    The diagonals of the cells of a height field go from their least corner, those of the mesh the other way.
    """
    rows, columns = heights.shape
    heights = heights - heights.min()
    if kind == "hfield":
        top = max(float(heights.max()), 1e-3)
        # MuJoCo reads rows from the far side.
        given = f'nrow="{rows}" ncol="{columns}" size="{half!r} {half!r} {top!r} .1" elevation="{numbers((heights[::-1] / top).ravel())}"'
        return f'<asset><hfield name="ground" {given}/></asset>', f'<geom name="{SURFACE}" type="hfield" hfield="ground"/>'
    x, y = np.meshgrid(np.linspace(-half, half, columns), np.linspace(-half, half, rows))
    vertices = np.stack([x, y, heights], axis=-1).ravel()
    corner = np.arange(rows * columns).reshape(rows, columns)
    p, q, s, t = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.stack([p, q, t, q, s, t], axis=-1).ravel()
    asset = f'<mesh name="ground" inertia="shell" vertex="{numbers(vertices)}" face="{" ".join(map(str, faces))}"/>'
    return f"<asset>{asset}</asset>", f'<geom name="{SURFACE}" type="mesh" mesh="ground"/>'
