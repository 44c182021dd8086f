"""Functions that make MJCF for the scenes. Units are SI and radians."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

G = 9.81
"""Gravity, m/s^2."""


def document(world: str, *, friction: float = 1.0, gravity: Iterable[float] = (0.0, 0.0, -G), before: str = "", after: str = "") -> str:
    """MJCF of a scene: content of the worldbody, friction of all geoms, gravity, and sections before and after the worldbody."""
    pull = numbers(gravity)
    return f"""<mujoco><compiler angle="radian"/><option gravity="{pull}"/><default><geom friction="{friction!r} 0 0"/></default>
      {before}<worldbody>{world}</worldbody>{after}</mujoco>"""


def numbers(values: Iterable[float]) -> str:
    """Text of numbers for an MJCF attribute, exact to the last bit."""
    return " ".join(repr(float(v)) for v in values)


FLOOR = '<geom name="floor" type="plane" size="0 0 1"/>'


def free(name: str, geom: str, pos: Iterable[float], quat: Iterable[float] = (1, 0, 0, 0), inside: str = "") -> str:
    """MJCF of a free body with one geom."""
    return f'<body name="{name}" pos="{numbers(pos)}" quat="{numbers(quat)}"><freejoint/><geom name="{name}" {geom}/>{inside}</body>'


def box(half: Iterable[float], mass: float) -> str:
    """MJCF attributes of a box geom: half sizes in m, mass in kg."""
    return f'type="box" size="{numbers(half)}" mass="{mass!r}"'


def ball(radius: float, mass: float) -> str:
    """MJCF attributes of a sphere geom: radius in m, mass in kg."""
    return f'type="sphere" size="{radius!r}" mass="{mass!r}"'


def about_y(angle: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a rotation about y by an angle in rad."""
    return (math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0)


def incline(geom: str, height: float, slope: float, friction: float) -> str:
    """MJCF of a scene with a free body on a plane inclined about y, downhill towards +x."""
    turn = about_y(slope)
    at = (height * math.sin(slope), 0.0, height * math.cos(slope))
    plane = f'<geom name="floor" type="plane" size="0 0 1" quat="{numbers(turn)}"/>'
    return document(plane + free("body", geom, at, turn), friction=friction)


SURFACE = "surface"
"""Name of mesh geoms that collide by their triangles instead of their convex hull. The name marks them: MJCF has no attribute for this."""


def surface(half: float, heights: NDArray[np.float64], kind: str) -> tuple[str, str]:
    """MJCF of the asset and MJCF of the geom of a terrain: heights (m, rows along y) over a square with half size `half` (m).

    The terrain is a height field with the kind "hfield", and a mesh with the kind "mesh".
    The diagonals of a height field's cells start at the corner with the smallest x and y. Those of the mesh are the other diagonals.
    """
    rows, columns = heights.shape
    heights = heights - heights.min()
    if kind == "hfield":
        top = max(float(heights.max()), 1e-3)
        # MuJoCo's XML lists rows from the largest y.
        given = f'nrow="{rows}" ncol="{columns}" size="{half!r} {half!r} {top!r} .1" elevation="{numbers((heights[::-1] / top).ravel())}"'
        return f'<asset><hfield name="ground" {given}/></asset>', f'<geom name="{SURFACE}" type="hfield" hfield="ground"/>'
    x, y = np.meshgrid(np.linspace(-half, half, columns), np.linspace(-half, half, rows))
    vertices = np.stack([x, y, heights], axis=-1).ravel()
    corner = np.arange(rows * columns).reshape(rows, columns)
    p, q, s, t = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.stack([p, q, t, q, s, t], axis=-1).ravel()
    asset = f'<mesh name="ground" inertia="shell" vertex="{numbers(vertices)}" face="{" ".join(map(str, faces))}"/>'
    return f"<asset>{asset}</asset>", f'<geom name="{SURFACE}" type="mesh" mesh="ground"/>'
