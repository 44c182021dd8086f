"""Frames for drawing: poses, contacts and scalars of some environments of a `Stepper` or of a recording at one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper._stepper import Stepper, selected
from stepper.viewer.looks import Array, sized_geoms
from stepper.viewer.shapes import Scene

Envs: TypeAlias = "int | ArrayLike | None"
"""Environments to show: their number, a range or list of indices, or None for all up to a limit."""


@dataclass(frozen=True)
class Frame:
    """State of n environments at one time, for drawing.

    Attributes:
        time: Simulated time, s: (n,).
        geom_xpos: Positions of the geoms, (n, ngeom, 3), m.
        geom_xquat: Orientations of the geoms, (n, ngeom, 4), quaternions (w, x, y, z).
        xpos: Positions of the bodies, (n, nbody, 3), m.
        xquat: Orientations of the bodies, (n, nbody, 4), quaternions (w, x, y, z).
        tendons: Paths of the spatial tendons, (n, k, 10, 3), m: the k parts between two sites, wrapped around spheres and cylinders.
        center: Centre of mass of the whole model in each environment, (n, 3), m.
        contact_env: Environment of each of the k contacts, as an index from 0 to n - 1 into the arrays of this frame: (k,).
        contact_pos: Positions of the contacts, (k, 3), m.
        contact_force: Forces on the second geoms in world axes, (k, 3), N.
        status: Flags of `stepper.Status`: (n,).
        residual: Residuals of the last steps, m/s: (n,).
        max_penetration: Largest penetrations of the last call of `step`, m: (n,).
    """

    time: Array
    geom_xpos: Array
    geom_xquat: Array
    xpos: Array
    xquat: Array
    tendons: Array
    center: Array
    contact_env: Array
    contact_pos: Array
    contact_force: Array
    status: Array
    residual: Array
    max_penetration: Array


def shown_envs(sim: Stepper, envs: Envs, most: int) -> Array:
    """Indices of the environments to show, (n,). `envs` is their number, a mask or a list of indices; None selects all, up to `most`.

    Raises:
        ValueError, IndexError: The stepper has no such environments, or none is selected.
    """
    count = sim.num_envs or 1
    if envs is None:
        return np.arange(min(count, most))
    if isinstance(envs, int):
        if not 1 <= envs <= count:
            raise ValueError(f"envs is {envs}, must be a number of environments up to {count}, a mask, or a list of indices")
        return np.arange(envs)
    chosen = np.array(selected(envs, count), dtype=np.int64)
    if not len(chosen):
        raise ValueError("envs selects no environment: select at least one to show, or leave envs out")
    return chosen


def frame_of(sim: Stepper, envs: Array) -> Frame:
    """Frame for drawing of the environments with the indices `envs`, (n,), of a stepper."""
    listed = sim.contacts()
    row = np.full((sim.num_envs or 1), -1)
    row[envs] = np.arange(len(envs))
    listed = listed[row[listed["env"]] >= 0]
    return Frame(
        **{
            name: values_of(sim, name, envs)
            for name in ("time", "geom_xpos", "geom_xquat", "xpos", "xquat", "status", "residual", "max_penetration")
        },
        tendons=values_of(sim, "tendon_paths", envs),
        center=values_of(sim, "subtree_com", envs)[:, 0],
        contact_env=row[listed["env"]],
        contact_pos=listed["pos"],
        contact_force=np.einsum("nij,ni->nj", listed["frame"], listed["force"]),
    )


def sizes_of(sim: Stepper, envs: Array, scene: Scene) -> Array:
    """Current sizes of all geoms in some environments, (n, ngeom, 3), m, including randomized sizes.

    Args:
        sim: The stepper.
        envs: Indices of the environments, (n,).
        scene: Drawing of the model, with the sizes of geoms that are not randomized.
    """
    sizes = np.tile(scene.sizes, (len(envs), 1, 1))
    if "geom_size" in sim.randomized:
        sized, shape = sized_geoms(sim.model), (sim.num_envs or 1, *sim.model.geom_size.shape)
        sizes[:, sized] = np.reshape(sim.randomized["geom_size"], shape)[envs][:, sized]
    return sizes


def values_of(sim: Stepper, name: str, envs: Array) -> Array:
    """Values of a quantity of a stepper in the environments with the indices `envs`, (n, ...), in its unit.

    A stepper with `num_envs=None` counts as one environment with index 0.
    """
    values = np.asarray(getattr(sim, name))
    chosen: Array = (values[None] if sim.num_envs is None else values)[envs]
    return chosen
