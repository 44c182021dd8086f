"""Region of space in which a model moves, and the place of a free camera that shows it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from stepper.viewer.looks import Array

_MARGIN = 1.1
"""Ratio of the camera's distance to the smallest one at which the region is inside the picture."""
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def region_of(mujoco: Any, m: Any, d: Any) -> tuple[Array, Array]:
    """Balls around all that moves at the pose of a `mujoco.MjData`: centres (n, 3) and radii (n,), m.

    The balls of radius 0 are corners of the boxes around moving geoms. A robot whose first joint is a hinge or ball joint adds the ball
    that it sweeps around this joint. Without a moving geom, fixed geoms count, without planes.
    """
    extended = m.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    moving = extended & (m.body_weldid[m.geom_bodyid] != 0)
    shown = np.flatnonzero(moving if moving.any() else extended)
    if not len(shown):
        return np.zeros((1, 3)), np.ones(1)
    boxes = m.geom_aabb[shown]
    local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
    corners = d.geom_xpos[shown, None] + np.einsum("gij,gkj->gki", d.geom_xmat[shown].reshape(-1, 3, 3), local)
    centres, radii = [corners.reshape(-1, 3)], [np.zeros(8 * len(shown))]
    turning = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL)}
    for joint in range(m.njnt):
        body = int(m.jnt_bodyid[joint])
        if int(m.jnt_type[joint]) not in turning or m.body_weldid[m.body_parentid[body]] != 0:
            continue
        carried = [k for k, geom in enumerate(shown) if _is_below(m, int(m.geom_bodyid[geom]), body)]
        if carried:
            anchor = d.xanchor[joint]
            centres.append(anchor[None])
            radii.append(np.array([np.linalg.norm(corners[carried] - anchor, axis=2).max()]))
    return np.concatenate(centres), np.concatenate(radii)


def _is_below(m: Any, body: int, ancestor: int) -> bool:
    """Whether a body is another one or a descendant of it."""
    while body > ancestor:
        body = int(m.body_parentid[body])
    return body == ancestor


def middle_of(centres: Array, radii: Array) -> Array:
    """Centre of the box around balls, (3,), m."""
    middle: Array = ((centres - radii[:, None]).min(axis=0) + (centres + radii[:, None]).max(axis=0)) / 2
    return middle


def distance_to(centres: Array, radii: Array, camera: Any, fovy: float, aspect: float) -> float:
    """Distance from its point of interest at which a free camera shows balls, m.

    Args:
        centres: Centres of the balls, (n, 3), m.
        radii: Radii of the balls, (n,), m.
        camera: The `mujoco.MjvCamera`, with azimuth, elevation and lookat.
        fovy: Vertical field of view, degrees.
        aspect: Width of the picture divided by its height.
    """
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    offsets = centres - camera.lookat
    upward = np.tan(np.radians(fovy) / 2)
    # A ball touches the side plane of the view: |lateral| cos(half) + radius = (distance + depth) sin(half).
    needed = [
        (np.abs(offsets @ axis) + radii * np.sqrt(1.0 + slope**2)) / slope - offsets @ forward
        for axis, slope in ((right, upward * aspect), (np.cross(right, forward), upward))
    ]
    return float(_MARGIN * np.max(needed))
