"""Scenes of bodies that pass close to each other without touching, and parts of floors made of tiles."""

import math
from dataclasses import dataclass

import numpy as np
import stepper
from geometry import cuboid, vertices

ROUNDING = {"f64": 1e-9, "f32": 1e-5}
"""Rounding error of a velocity after some hundred steps, relative to the speed."""
FRICTIONLESS = '<default><geom friction="0" condim="1"/></default>'


def scene_xml(world: str, *, timestep: float, gravity: float = 0.0, assets: str = "") -> str:
    """MJCF of a world without friction. `timestep` is in s, `gravity` in m/s^2 downwards."""
    return (
        f'<mujoco><compiler inertiafromgeom="true"/><option timestep="{timestep}" gravity="0 0 {-gravity}"/>{FRICTIONLESS}'
        f"<asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>"
    )


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
FIELD = '<hfield name="flat" nrow="3" ncol="3" size=".05 1 .1 .05" elevation="0 0 0 0 0 0 0 0 0"/>'
ASSETS = MESHES + FIELD

OBSTACLES = {
    "box": '<geom type="box" size=".3 .3 .3" pos=".3 0 -.3"/>',
    "capsule": '<geom type="capsule" size=".03 .2" pos=".1 0 -.23"/>',
    "cylinder": '<geom type="cylinder" size=".05 .1" pos=".1 0 -.1"/>',
    "sphere": '<geom type="sphere" size=".1" pos=".1 0 -.1"/>',
    "hull": '<geom type="mesh" mesh="brick" pos=".1 0 -.02"/>',
    "field": '<geom type="hfield" hfield="flat" pos=".1 0 0"/>',
}
"""Geoms whose highest points are at height 0."""


def fly(sim: stepper.Stepper, v: list[float], distance: float) -> float:
    """Let free bodies fly for a distance in m. Return the largest change of their velocity, relative to its largest speed and spin."""
    # Spins below 1 rad/s count as 1 rad/s.
    sim.set_state(qvel=v)
    linear, angular = (np.reshape(v, (-1, 2, 3))[:, k] for k in (0, 1))
    speed, spin, largest_change = np.abs(linear).max(), max(np.abs(angular).max(), 1.0), 0.0
    for _ in range(math.ceil(distance / speed / sim.timestep)):
        sim.step()
        change = np.abs(np.reshape(sim.qvel - v, (-1, 2, 3))).max(axis=(0, 2))
        largest_change = max(largest_change, change[0] / speed, change[1] / spin)
        assert not sim.status
    return largest_change


@dataclass(frozen=True)
class Floor:
    """Flat floor of flush tiles.

    Attributes:
        kind: Shape of the tiles: "boxes", "meshes", "fields", or "mixed" for all three in turn.
        width: Width of a tile, m.
        yaw: Angle between the row of tiles and the x axis, degrees.
    """

    kind: str
    width: float = 0.1
    yaw: float = 0.0

    def assets(self) -> str:
        """Mesh and height field of a tile, as MJCF."""
        half = self.width / 2
        field = f'<hfield name="level" nrow="3" ncol="3" size="{half} 1 .1 .05" elevation="0 0 0 0 0 0 0 0 0"/>'
        return MESHES + field + f'<mesh name="tile" vertex="{cuboid(half, 1, 0.05)}"/>'

    def tiles(self, length: float) -> str:
        """Tiles from -4 widths to a distance of `length` m along the x axis, as MJCF."""
        shapes = {
            "boxes": (f'type="box" size="{self.width / 2} 1 .05"', 0.05),
            "meshes": ('type="mesh" mesh="tile"', 0.05),
            "fields": ('type="hfield" hfield="level"', 0.0),
        }
        kinds = list(shapes) if self.kind == "mixed" else [self.kind]
        c, s = math.cos(math.radians(self.yaw)), math.sin(math.radians(self.yaw))
        out = ""
        for k in range(-4, math.ceil(length / self.width) + 4):
            shape, below = shapes[kinds[(k + 4) % len(kinds)]]
            out += f'<geom {shape} pos="{k * self.width * c} {k * self.width * s} {-below}" euler="0 0 {self.yaw}"/>'
        return out
