"""Step time of mjlab's Go1 on a ground, in stepper and in MuJoCo: a ground is a scene of `many_contacts`."""

import re
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from many_contacts.assets import Assets, written
from many_contacts.measure import Plan, measure
from many_contacts.scene import Array, Phase, Scene, Script
from many_contacts.scenes import unitree
from stepper import Model, ModelWarning, load

from terrains.grounds import Ground

SPREAD = 3.0
"""Half the side of the square in which robots start, m."""


def _spec(add: Callable[[Any], None], assets: Assets) -> Any:
    """Model specification (`MjSpec`) of the robot on the ground that `add` adds."""
    spec = unitree.spec(unitree.GO1, assets)
    spec.delete(spec.geom("floor"))
    add(spec)
    return spec


def build(ground: Ground, cache: Path, out: Path) -> tuple[Model, Path]:
    """Model of stepper for a robot on a ground, and file of MuJoCo's model."""
    assets, name = Assets(cache), "go1_" + re.sub(r"\W+", "_", ground.name) + ".xml"
    path = written(_spec(ground.add, assets), out / name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        if ground.mesh is None:
            return load(path), path
        model = load(written(_spec(ground.mesh, assets), out / "meshes" / name))
    concave = model.geom_concave.copy()
    concave[list(model.geom_names).index("ground")] = 1
    return model.replace(geom_concave=concave), path


def script(ground: Ground, noise: float, model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) on a ground.

    The robots start above the ground, and get the random actions of an untrained policy.
    """
    found = unitree.script(unitree.GO1, model, num_envs, rng, noise)
    places = np.random.default_rng(1)
    for qpos in (found.qpos, *(() if found.reset_qpos is None else found.reset_qpos)):
        qpos[:, :2] = places.uniform(-SPREAD, SPREAD, (num_envs, 2))
        qpos[:, 2] += _foothold(ground, qpos)
    return found


def _foothold(ground: Ground, qpos: Array) -> Array:
    """Largest height of the ground under each robot, m."""
    around = np.linspace(-0.35, 0.35, 15)
    dx, dy = (d.ravel() for d in np.meshgrid(around, around))
    return np.asarray(np.max(ground.height(qpos[:, :1] + dx, qpos[:, 1:2] + dy), axis=1))


def measured(ground: Ground, plan: Plan, steps: int, noise: float, *, cache: Path, out: Path) -> dict[str, Any]:
    """Measurements of an episode of `steps` steps on a ground, in the format of `many_contacts`.

    `noise` is the standard deviation of the random actions, as a factor of that of mjlab's untrained policy.
    """
    model, path = build(ground, cache, out)
    spec, starts = partial(_spec, ground.add), partial(script, ground, noise)
    (row,) = measure(Scene(ground.name, "", spec, starts, (Phase("walks", steps),)), path, plan, model)
    return row
