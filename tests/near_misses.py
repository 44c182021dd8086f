"""Scenes of bodies that pass close to each other without touching, and parts of floors made of tiles."""

from __future__ import annotations

import math

FRICTIONLESS = '<default><geom friction="0" condim="1"/></default>'


def scene_xml(world: str, *, timestep: float, gravity: float = 0.0, assets: str = "") -> str:
    """MJCF of a world without friction. `timestep` is in s, `gravity` in m/s^2 downwards."""
    return (
        f'<mujoco><compiler inertiafromgeom="true"/><option timestep="{timestep}" gravity="0 0 {-gravity}"/>{FRICTIONLESS}'
        f"<asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>"
    )


def vertices(corners: list[tuple[float, float, float]]) -> str:
    """Vertex coordinates of a mesh as MJCF, m."""
    return " ".join(f"{x:.9g}" for corner in corners for x in corner)


def cuboid(x: float, y: float, z: float) -> str:
    """Vertices of a cuboid from its half sizes, m, as MJCF."""
    return vertices([(i * x, j * y, k * z) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])


def hull(radius: float) -> str:
    """Vertices of a pyramid on a hexagon, as high as its radius, m, as MJCF."""
    base = [(radius * math.cos(k * math.pi / 3), radius * math.sin(k * math.pi / 3), -radius / 3) for k in range(6)]
    return vertices([*base, (0, 0, 2 * radius / 3)])


MOVERS = {
    "sphere": ('<geom type="sphere" size=".02" mass="1"/>', 0.02),
    "capsule": ('<geom type="capsule" size=".02 .03" mass="1" euler="0 90 0"/>', 0.02),
    "upright capsule": ('<geom type="capsule" size=".02 .03" mass="1"/>', 0.05),
    "cylinder": ('<geom type="cylinder" size=".06 .03" mass="1"/>', 0.03),
    "lying cylinder": ('<geom type="cylinder" size=".03 .04" mass="1" euler="90 0 0"/>', 0.03),
    "box": ('<geom type="box" size=".02 .02 .02" mass="1"/>', 0.02),
    "ellipsoid": ('<geom type="ellipsoid" size=".03 .02 .02" mass="1"/>', 0.02),
    "hull": ('<geom type="mesh" mesh="hull" mass="1"/>', 0.01),
    "mesh box": ('<geom type="mesh" mesh="brick" mass="1"/>', 0.02),
}
"""Geom of each moving body, and the height of its centre above its lowest point, m."""

MESHES = f'<mesh name="hull" vertex="{hull(0.03)}"/><mesh name="brick" vertex="{cuboid(0.03, 0.02, 0.02)}"/>'
