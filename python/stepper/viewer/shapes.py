"""Drawing of a model as scaled instances of a few meshes, one or more instances per geom.

A sphere, ellipsoid, cylinder or box is one scaled mesh of unit size; a capsule is a cylinder and two spheres. A batch of robots is thus
drawn as a few meshes with many instances, even if sizes of geoms differ between environments.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.viewer.looks import Array

RINGS, SEGMENTS = 12, 24
"""Numbers of faces of round meshes: from pole to pole, and around the axis."""
PLAIN = (0.62, 0.66, 0.72, 1.0)
"""Colour of geoms whose colour is unknown."""
VISIBLE_GROUPS = 3
"""First group of geoms that is hidden initially, as in MuJoCo's viewer; later groups are hidden, too.

These groups often contain the collision geometry of robots with meshes.
"""
UNSEEN = 1e-3
"""Opacity below which a geom is not drawn. Some models hide geoms in this way."""

Axes: TypeAlias = tuple[int, int, int]


@dataclass(frozen=True)
class Mesh:
    """Triangle mesh.

    Attributes:
        vertices: Vertices, (n, 3) float32, m.
        faces: Indices of the vertices of each face, (m, 3) int32.
        flat: Whether to draw flat faces with sharp edges, instead of a smooth surface.
    """

    vertices: Array
    faces: Array
    flat: bool


@dataclass(frozen=True)
class Part:
    """Instances of one mesh, which the viewer draws together as one batch. All environments have the same instances.

    Attributes:
        name: Name of the mesh.
        mesh: The mesh.
        geom: Index of the geom of each instance, (n,).
        axes: Index into `geom_size` of the number that scales each axis of the mesh, (n, 3); 3 means no scaling.
        end: Position of the mesh on the z axis of its geom, (n,), in multiples of `geom_size[1]`.
        rgba: Colours, (n, 4), from 0 to 1.
        group: Number of MuJoCo's geom group. The viewer shows or hides all geoms of a group together.
    """

    name: str
    mesh: Mesh
    geom: Array
    axes: Array
    end: Array
    rgba: Array
    group: int


@dataclass(frozen=True)
class Scene:
    """Drawing of a model.

    Attributes:
        parts: Instances of meshes.
        planes: Indices of the planes that are drawn as floors, because they are infinite or larger than `extent`.
        sizes: Sizes of the geoms, (ngeom, 3), m; for planes that are drawn as finite rectangles, the size in the source.
        rgba: Colours of all geoms, (ngeom, 4).
        shown: Groups of geoms that are visible initially.
        center: Middle of the bounding box at the reference pose, (3,), m. The box contains the geoms of all bodies other than the world, or
            all geoms if no other body has geoms.
        extent: Diagonal of this bounding box, m. Lengths of arrows and distances of environments are proportional to it.
        missing: Indices of the geoms that are not drawn because their meshes or height fields are unknown.
    """

    parts: tuple[Part, ...]
    planes: tuple[int, ...]
    sizes: Array
    rgba: Array
    shown: frozenset[int]
    center: Array
    extent: float
    missing: tuple[int, ...]


def scene_of(model: Model, looks: Any | None) -> Scene:
    """Drawing of a model.

    Args:
        model: The model.
        looks: `mujoco.MjModel` from `looks_of`. With None, meshes and height fields are missing, and colours are plain.
    """
    rgba = np.tile(PLAIN, (model.ngeom, 1)) if looks is None else _colours(looks)
    groups = [0] * model.ngeom if looks is None else looks.geom_group.tolist()
    sizes = np.array(model.geom_size, subok=False)
    drawn: dict[tuple[str, int, bool], tuple[Mesh, list[tuple[int, Axes, float]]]] = {}
    planes, missing = [], []
    center, extent = _box_around(model, looks)
    for g in range(model.ngeom):
        kind = model.geom(g).type
        if rgba[g, 3] < UNSEEN:
            continue
        if kind == "plane":
            # For contacts every plane is infinite. A plane with a size is drawn as a finite rectangle, unless it is as large as a floor.
            if looks is None or not np.all(looks.geom_size[g, :2] > 0) or np.all(looks.geom_size[g, :2] > extent):
                planes.append(g)
                continue
            sizes[g] = looks.geom_size[g]
        pieces = _pieces(kind, g, looks)
        if not pieces:
            missing.append(g)
        for name, mesh, axes, end in pieces:
            key = (name, groups[g], bool(rgba[g, 3] < 1))
            drawn.setdefault(key, (mesh, []))[1].append((g, axes, end))
    parts = []
    for (name, group, _), (mesh, rows) in drawn.items():
        geom = np.array([g for g, _, _ in rows])
        scaled, along = np.array([axes for _, axes, _ in rows]), np.array([end for _, _, end in rows])
        parts.append(Part(name, mesh, geom, scaled, along, rgba[geom], group))
    return Scene(tuple(parts), tuple(planes), sizes, rgba, _shown(model, parts), center, extent, tuple(missing))


def _pieces(kind: str, g: int, looks: Any | None) -> list[tuple[str, Mesh, Axes, float]]:
    """Meshes that draw a geom: three meshes for a capsule, one mesh for other geoms, and none if the mesh of the geom is unknown.

    Returns:
        Tuple for each mesh: its name, the mesh, the indices into `geom_size` that scale its axes (`Part.axes`), and its position on the z
        axis of the geom (`Part.end`).
    """
    if kind == "capsule":
        return [("tube", _TUBE, (0, 0, 1), 0.0), ("sphere", _SPHERE, (0, 0, 0), -1.0), ("sphere", _SPHERE, (0, 0, 0), 1.0)]
    if kind in _SIMPLE:
        mesh, axes = _SIMPLE[kind]
        return [("sphere" if kind == "ellipsoid" else kind, mesh, axes, 0.0)]
    if looks is None:
        return []
    asset = int(looks.geom_dataid[g])
    mesh = _height_field(looks, asset) if kind == "hfield" else _mesh(looks, asset)
    return [(f"{kind} {asset}", mesh, (3, 3, 3), 0.0)]


def _mesh(looks: Any, asset: int) -> Mesh:
    """Mesh asset of a compiled `mujoco.MjModel`, by its index."""
    vertices = slice(int(looks.mesh_vertadr[asset]), int(looks.mesh_vertadr[asset] + looks.mesh_vertnum[asset]))
    faces = slice(int(looks.mesh_faceadr[asset]), int(looks.mesh_faceadr[asset] + looks.mesh_facenum[asset]))
    return Mesh(np.array(looks.mesh_vert[vertices], np.float32), np.array(looks.mesh_face[faces], np.int32), flat=True)


def _height_field(looks: Any, asset: int) -> Mesh:
    """Surface of a height field asset of a compiled `mujoco.MjModel`, by its index, with two triangles per cell."""
    rows, columns, start = int(looks.hfield_nrow[asset]), int(looks.hfield_ncol[asset]), int(looks.hfield_adr[asset])
    x, y, top, _ = looks.hfield_size[asset].tolist()
    heights = looks.hfield_data[start : start + rows * columns] * top
    grid_y, grid_x = np.meshgrid(np.linspace(-y, y, rows), np.linspace(-x, x, columns), indexing="ij")
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    vertices = np.stack([grid_x.ravel(), grid_y.ravel(), heights], axis=1).astype(np.float32)
    return Mesh(vertices, np.concatenate([lower, upper]).astype(np.int32), flat=True)


def _colours(looks: Any) -> Array:
    """Colours of all geoms of a compiled `mujoco.MjModel`, (ngeom, 4), from 0 to 1.

    The colour is that of the geom or of its material, times the mean colour of the material's texture.
    """
    rgba = np.array(looks.geom_rgba, np.float64)
    texture = _texture_colours(looks)
    for g in range(looks.ngeom):
        material = int(looks.geom_matid[g])
        if material < 0:
            continue
        # As in MuJoCo, the geom's colour has priority over its material, unless the geom has MuJoCo's default colour.
        if np.array_equal(rgba[g], [0.5, 0.5, 0.5, 1.0]):
            rgba[g] = looks.mat_rgba[material]
        chosen = [int(t) for t in looks.mat_texid[material] if t >= 0]
        if chosen:
            rgba[g, :3] *= texture[chosen[0]]
    return np.clip(rgba, 0.0, 1.0)


def _texture_colours(looks: Any) -> list[Array]:
    """Mean colour of each texture of a compiled `mujoco.MjModel`, (3,), from 0 to 1."""
    found = []
    for t in range(looks.ntex):
        channels, start = int(looks.tex_nchannel[t]), int(looks.tex_adr[t])
        pixels = looks.tex_data[start : start + int(looks.tex_width[t]) * int(looks.tex_height[t]) * channels].reshape(-1, channels)
        mean = pixels.mean(axis=0) / 255.0
        found.append(mean[:3] if channels >= 3 else np.full(3, mean[0]))
    return found


def instances(part: Part, sizes: Array, xpos: Array, xquat: Array) -> tuple[Array, Array, Array]:
    """Poses and scales of the instances of a part in all environments.

    Args:
        part: The part, of k instances.
        sizes: Sizes of the geoms, (n, ngeom, 3), m, or (1, ngeom, 3) for all environments.
        xpos: Positions of the geoms, (n, ngeom, 3), m.
        xquat: Orientations of the geoms, (n, ngeom, 4), quaternions (w, x, y, z).

    Returns:
        Positions (n k, 3), m, orientations (n k, 4) and scales (n k, 3) of the part's mesh.
    """
    n, k = len(xpos), len(part.geom)
    size = np.concatenate([sizes[:, part.geom], np.ones((len(sizes), k, 1))], axis=2)
    scale = np.take_along_axis(size, np.broadcast_to(part.axes, (len(sizes), k, 3)), axis=2)
    w, x, y, z = np.moveaxis(xquat[:, part.geom], -1, 0)
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)  # The z axis of each geom.
    along = part.end * np.where(part.end == 0, 0.0, size[..., 1])
    place = xpos[:, part.geom] + along[..., None] * axis
    return place.reshape(-1, 3), xquat[:, part.geom].reshape(-1, 4), np.broadcast_to(scale, (n, k, 3)).reshape(-1, 3)


def _shown(model: Model, parts: list[Part]) -> frozenset[int]:
    """Groups of geoms that are visible initially: the first `VISIBLE_GROUPS`, as in MuJoCo.

    If one of these has only visual geoms, groups with only colliding geoms are hidden.
    """
    solid = np.array([bool(geom.contype or geom.conaffinity) for geom in map(model.geom, range(model.ngeom))])
    collides = {group: {bool(solid[g]) for part in parts if part.group == group for g in part.geom} for group in {p.group for p in parts}}
    first = {group for group in collides if group < VISIBLE_GROUPS}
    only_visual = {group for group in first if collides[group] == {False}}
    return frozenset({group for group in first if collides[group] != {True}} if only_visual else first)


def _box_around(model: Model, looks: Any | None) -> tuple[Array, float]:
    """Middle, (3,), m, and diagonal, m, of a bounding box at the reference pose.

    The box contains the geoms of all bodies other than the world, or all geoms if there are no such geoms.
    """
    at = np.asarray(Stepper(model).geom_xpos)
    body = np.array([model.geom(g).bodyid for g in range(model.ngeom)], dtype=np.int64)
    moving = np.flatnonzero(body > 0)
    chosen = moving if len(moving) else np.arange(model.ngeom)
    if not len(chosen):
        return np.zeros(3), 1.0
    reach = np.linalg.norm(model.geom_size, axis=1) if looks is None else np.where(looks.geom_rbound > 0, looks.geom_rbound, 0.0)
    low, high = (at - reach[:, None])[chosen].min(axis=0), (at + reach[:, None])[chosen].max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-3)


def _round(heights: Array, radii: Array) -> Mesh:
    """Surface of revolution about the z axis through points with the given heights and radii, (n,) each, m."""
    angle = np.linspace(0.0, 2 * np.pi, SEGMENTS, endpoint=False)
    vertices = np.stack([np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)), np.outer(heights, np.ones(SEGMENTS))], axis=-1)
    row, column = np.meshgrid(np.arange(len(heights) - 1), np.arange(SEGMENTS), indexing="ij")
    here, right = row * SEGMENTS + column, row * SEGMENTS + (column + 1) % SEGMENTS
    faces = np.concatenate([
        np.stack([here, right, right + SEGMENTS], axis=-1).reshape(-1, 3),
        np.stack([here, right + SEGMENTS, here + SEGMENTS], axis=-1).reshape(-1, 3),
    ])  # fmt: skip
    return Mesh(vertices.reshape(-1, 3).astype(np.float32), faces.astype(np.int32), flat=False)


def _box() -> Mesh:
    """Cube of side 2 m. Faces do not share vertices, so that the edges are sharp."""
    vertices: list[Array] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            first, second = ((axis + 1) % 3, (axis + 2) % 3) if side > 0 else ((axis + 2) % 3, (axis + 1) % 3)
            start = len(vertices)
            for a, b in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
                corner = np.zeros(3)
                corner[axis], corner[first], corner[second] = side, a, b
                vertices.append(corner)
            faces += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
    return Mesh(np.array(vertices, np.float32), np.array(faces, np.int32), flat=True)


def _cylinder() -> Mesh:
    """Cylinder of radius 1 m from z = -1 m to 1 m. Lids do not share vertices with the side, so that the edges are sharp."""
    side = _TUBE
    lids: list[Array] = []
    angle = np.linspace(0.0, 2 * np.pi, SEGMENTS, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    faces = [side.faces]
    for end in (-1.0, 1.0):
        start = len(side.vertices) + len(lids) * (SEGMENTS + 1)
        lids.append(np.concatenate([np.column_stack([rim, np.full(SEGMENTS, end)]), [[0.0, 0.0, end]]]))
        ring = np.arange(SEGMENTS)
        turned = (ring, (ring + 1) % SEGMENTS) if end > 0 else ((ring + 1) % SEGMENTS, ring)
        faces.append(np.stack([start + turned[0], start + turned[1], np.full(SEGMENTS, start + SEGMENTS)], axis=1))
    return Mesh(np.concatenate([side.vertices, *lids]).astype(np.float32), np.concatenate(faces).astype(np.int32), flat=False)


_POLAR = np.linspace(0.0, np.pi, RINGS + 1)
_SPHERE = _round(-np.cos(_POLAR), np.sin(_POLAR))
_TUBE = _round(np.array([-1.0, 1.0]), np.ones(2))
_CYLINDER = _cylinder()
_BOX = _box()
FLAT = Mesh(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32), flat=True)
_SIMPLE: dict[str, tuple[Mesh, Axes]] = {
    "sphere": (_SPHERE, (0, 0, 0)),
    "ellipsoid": (_SPHERE, (0, 1, 2)),
    "cylinder": (_CYLINDER, (0, 0, 1)),
    "box": (_BOX, (0, 1, 2)),
    "plane": (FLAT, (0, 1, 3)),
}
