"""Quantities of a robot on rough terrain that observations and rewards share."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stepper._quantities import headings
from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.contacts import contact_forces
from stepper.envs.locomotion.base import in_base
from stepper.envs.task import Array, Moment, per_moment

SCAN = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.5, 0.5, 11), indexing="ij"), axis=-1).reshape(-1, 2)
"""Points of the height scan relative to the base, ahead and to the left, (187, 2) m."""
_SLOPE_WEIGHTS = SCAN / (SCAN**2).sum(axis=0)
"""Matrix from scanned heights to the slopes (ahead, left) of the plane that fits them best, (187, 2) 1/m."""


@per_moment
def heading(now: Moment) -> Array:
    """Heading of the base: angle of its x axis about the vertical, (num_envs,) rad."""
    return headings(now.qpos[:, 3:7])


@per_moment
def ground_scan(now: Moment) -> Array:
    """Heights of the ground at the points of the scan, which turns with the heading of the base: (num_envs, 187) m."""
    scan: Array = now.task.terrain.ground.around(now.qpos[:, :2], heading(now), SCAN, beyond=0.0)
    return scan


@per_moment
def ground_normal(now: Moment) -> Array:
    """Unit vector normal to the plane that fits the scanned ground best, in the frame of the base, (num_envs, 3)."""
    slopes = np.einsum("nk,ki->ni", ground_scan(now), _SLOPE_WEIGHTS)
    c, s = np.cos(heading(now)), np.sin(heading(now))
    normal = np.stack([s * slopes[:, 1] - c * slopes[:, 0], -s * slopes[:, 0] - c * slopes[:, 1], np.ones(len(c))], axis=1)
    return in_base(now, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None])


@per_moment
def foot_heights(now: Moment) -> Array:
    """Heights of the feet's sites above the ground: (num_envs, nfeet) m."""
    places = now.site_xpos[:, _sites(now.sim.model, tuple(now.task.FEET))]
    heights: Array = places[..., 2] - now.task.terrain.height(places[..., :2])
    return heights


@per_moment
def foot_speeds(now: Moment) -> Array:
    """Horizontal speeds of the feet's sites: (num_envs, nfeet) m/s."""
    model = now.sim.model
    sites = _sites(model, tuple(now.task.FEET))
    bodies = _bodies(model, tuple(now.task.FEET))
    velocity = now.body_linvel[:, bodies] + np.cross(now.body_angvel[:, bodies], now.site_xpos[:, sites] - now.xpos[:, bodies])
    speeds: Array = np.hypot(velocity[..., 0], velocity[..., 1])
    return speeds


@per_moment
def foot_forces(now: Moment) -> Array:
    """Normal forces between the feet and the terrain in the last time step: (num_envs, nfeet) N."""
    geoms = now.task.FEET.values()
    forces = contact_forces(now, [name for names in geoms for name in names], ["terrain"])
    ends = np.cumsum([0, *map(len, geoms)])
    return np.stack([forces[:, a:b].sum(axis=1) for a, b in pairwise(ends)], axis=1)


@cache_per_model
def _sites(model: Model, names: tuple[str, ...]) -> list[int]:
    """Indices of the sites `names` of a model, in the same order."""
    return [model.site(name).id for name in names]


@cache_per_model
def _bodies(model: Model, names: tuple[str, ...]) -> list[int]:
    """Indices of the bodies to which the sites `names` of a model belong, in the same order."""
    return [model.site(name).bodyid for name in names]


@cache_per_model
def action_scale(model: Model) -> Array:
    """Change of a servo's set point by an action of 1: (nu,) rad. It gives a quarter of the largest torque, as in mjlab."""
    scale: Array = model.actuator_forcerange[:, 1] / (4.0 * model.actuator_gainprm[:, 0])
    return scale
