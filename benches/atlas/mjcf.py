"""Pieces of MJCF that scenes share. SI units, radians."""

from __future__ import annotations

import math
from collections.abc import Iterable

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
