"""Kinds of ground for a quadruped: geoms of an `MjSpec`, and the height of the surface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from many_contacts.scene import Array

BOX, PLANE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_PLANE

Height = Callable[[Array, Array], Array]
"""Function from positions x and y to the height of the ground, m."""


@dataclass(frozen=True)
class Ground:
    """Kind of ground.

    Attributes:
        name: Name in tables.
        add: Function that adds the geoms to an `MjSpec`.
        height: Function from positions x and y to the height of the ground, m.
        mesh: Function that stepper uses in place of `add`: it adds the concave mesh "ground". With None both engines use `add`.
    """

    name: str
    add: Callable[[Any], None]
    height: Height
    mesh: Callable[[Any], None] | None = None


POINTS, HALF = 100, 5.0
"""Number of points along each side of the height field, and half of its width, m."""
STEP_DEPTH, STEP_HEIGHT, STAIRS = 0.3, 0.1, 30
"""Depth and height of a stair, m, and number of stairs."""
STONES = 200


def _flat(x: Array, _: Array) -> Array:
    """Height of flat ground, 0, at positions x."""
    return np.zeros_like(x)


def _plane(spec: Any) -> None:
    """Add a plane to an `MjSpec`."""
    spec.worldbody.add_geom(name="floor", type=PLANE, size=[0, 0, 0.01])


def _box(spec: Any, half: list[float], pos: list[float]) -> None:
    """Add a box to an `MjSpec`, with half sizes and a position, m."""
    spec.worldbody.add_geom(type=BOX, size=half, pos=pos)


def _stairs(spec: Any) -> None:
    """Add a flight of stairs along x to an `MjSpec`."""
    for k in range(STAIRS):
        top = STEP_HEIGHT * (k + 1)
        _box(spec, [STEP_DEPTH / 2, 4.0, top / 2], [STEP_DEPTH * (k - STAIRS / 2 + 0.5), 0.0, top / 2])


def _stair_height(x: Array, _: Array) -> Array:
    """Height of the stairs at positions x, m."""
    return STEP_HEIGHT * np.clip(np.floor(x / STEP_DEPTH + STAIRS / 2) + 1, 1, STAIRS)


def elevation() -> Array:
    """Heights of the height field, m: waves, and roughness of 3 cm. The array (POINTS, POINTS) has the indices (y, x)."""
    line = np.linspace(-HALF, HALF, POINTS)
    x, y = np.meshgrid(line, line)
    return 0.1 + 0.07 * np.sin(1.5 * x) * np.cos(1.2 * y) + np.random.default_rng(0).uniform(0.0, 0.03, x.shape)


def _field(spec: Any) -> None:
    """Add the height field to an `MjSpec`."""
    z = elevation()
    low, high = float(z.min()), float(z.max())
    asset = spec.add_hfield(name="rough", nrow=POINTS, ncol=POINTS, size=[HALF, HALF, high - low, 0.5])
    asset.userdata = ((z - low) / (high - low)).ravel()
    spec.worldbody.add_geom(name="rough", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="rough", pos=[0, 0, low])


def _mesh(spec: Any) -> None:
    """Add the surface of the height field to an `MjSpec`, as a mesh of triangles."""
    line = np.linspace(-HALF, HALF, POINTS)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x, y, elevation()], axis=-1).reshape(-1, 3)
    corner = (np.arange(POINTS - 1)[:, None] * POINTS + np.arange(POINTS - 1)).ravel()
    beside, above, across = corner + 1, corner + POINTS, corner + POINTS + 1
    faces = np.concatenate([np.stack([corner, beside, across], axis=-1), np.stack([corner, across, above], axis=-1)])
    spec.add_mesh(name="ground", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, uservert=vertices.ravel(), userface=faces.ravel())
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ground")


def _field_height(x: Array, y: Array) -> Array:
    """Height of the field at the grid points nearest to positions x and y, m."""
    z = elevation()
    column, row = (np.clip(np.rint((at + HALF) / (2 * HALF) * (POINTS - 1)).astype(int), 0, POINTS - 1) for at in (x, y))
    return np.asarray(z[row, column])


def _stones() -> Array:
    """Centres in x and y, half sizes and yaw angle of each stone, (STONES, 6)."""
    rng = np.random.default_rng(1)
    return np.column_stack(
        [
            rng.uniform(-4, 4, (STONES, 2)),
            rng.uniform(0.1, 0.25, (STONES, 2)),
            rng.uniform(0.02, 0.08, STONES),
            rng.uniform(-1.5, 1.5, STONES),
        ]
    )


def _stones_and_floor(spec: Any) -> None:
    """Add a plane, and stones on it, to an `MjSpec`."""
    _plane(spec)
    for x, y, a, b, c, turn in _stones():
        spec.worldbody.add_geom(type=BOX, size=[a, b, c], pos=[x, y, c], quat=[np.cos(turn / 2), 0, 0, np.sin(turn / 2)])


def _stone_height(x: Array, y: Array) -> Array:
    """Upper bound of the height of the ground at positions x and y, m. Each stone counts as a disc around its corners."""
    height = np.zeros_like(x)
    for cx, cy, a, b, c, _ in _stones():
        height = np.where(np.hypot(x - cx, y - cy) < np.hypot(a, b), np.maximum(height, 2 * c), height)
    return height


def _tiles(count: int) -> Callable[[Any], None]:
    """Create a function that adds a square of `count` boxes with slightly different heights to an `MjSpec`."""

    def add(spec: Any) -> None:
        side = int(np.ceil(np.sqrt(count)))
        rng = np.random.default_rng(2)
        for k in range(count):
            x, y = (0.3 * (i - side / 2 + 0.5) for i in divmod(k, side))
            _box(spec, [0.15, 0.15, 0.1], [x, y, -0.1 + rng.uniform(-0.02, 0.02)])

    return add


def _far_boxes(spec: Any) -> None:
    """Add a plane to an `MjSpec`, and boxes that the robot cannot reach."""
    _plane(spec)
    for k in range(200):
        _box(spec, [0.15, 0.15, 0.1], [50.0 + 0.5 * (k % 20), 0.5 * (k // 20), 0.1])


def _tile_height(x: Array, _: Array) -> Array:
    """Upper bound of the height of the tiles, m, the same at all positions."""
    return np.full_like(x, 0.02)


GROUNDS = (
    Ground("flat", _plane, _flat),
    # Boxes of STEP_DEPTH x 8 m, each STEP_HEIGHT above the last.
    Ground("stairs", _stairs, _stair_height),
    # POINTS x POINTS points over 10 x 10 m, rough by 3 cm.
    Ground("height field", _field, _field_height),
    Ground("stones", _stones_and_floor, _stone_height),
    # Triangles of the height field in stepper; the height field itself in MuJoCo.
    Ground("concave mesh", _field, _field_height, mesh=_mesh),
    # A plane, and 200 boxes 50 m away.
    Ground("far boxes", _far_boxes, _flat),
    # 3,000 boxes of 0.3 x 0.3 m side by side.
    Ground("3,000 tiles", _tiles(3000), _tile_height),
)
