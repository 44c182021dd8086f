"""dm_control's swimmer: a planar chain of links in a fluid, and a target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_joints, reading, rotation, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.view import per_moment

_SIZE = 0.1
"""Radius of the target, m."""


@dataclass(frozen=True, kw_only=True)
class Swimmer(SuiteTask):
    """Task: swim until the nose is in the target.

    Attributes:
        links: Number of links.
    """

    file = "swimmer.xml"
    frame_skip: int = 15
    links: int = 6

    def model(self) -> Model:
        """Model of the chain of links."""
        return _scene(self.links)

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, target in the frame of the head, velocities of the links in their frames: (4 links + 1,)."""
        return (
            Observation("joints", func=lambda now: now.qpos[:, 3:], unit="rad"),
            Observation("to_target", func=_to_target, unit="m"),
            Observation("body_velocities", func=_velocities, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the nose in the target, decreasing with the distance from it."""
        return tolerance(norm(_to_target(now)), 0.0, _SIZE, margin=5.0 * _SIZE, fall="long_tail")

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random heading."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
        box = np.where(reset.rng.uniform(0.0, 1.0, 1) < 0.2, 0.3, 2.0)
        reset.sim.randomize({"geom_pos[target][0,1]": box * reset.rng.uniform(-1.0, 1.0, 2)}, envs=reset.envs)


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the nose to the target, in the frame of the head, m: (num_envs, 2)."""
    model = now.sim.model
    difference = now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, model.geom("nose").id]
    local: Array = np.einsum("ni,nij->nj", difference, rotation(now, "head"))[:, :2]
    return local


def _velocities(now: TaskView) -> Array:
    """Velocity along x and y (m/s) and about z (rad/s) of every link, in the link's frame: (num_envs, links, 3)."""
    names = [f"{kind}_{k}" for k in range(now.sim.model.nbody - 2) for kind in ("velocimeter", "gyro")]
    both: Array = reading(now, "head_vel", "head_gyro", *names).reshape(len(now.qpos), -1, 6)
    return both[..., [0, 1, 5]]


@cache_model
def _scene(links: int) -> Model:
    """Model of dm_control's swimmer with this number of links."""
    if links < 3:
        raise ValueError(f"links is {links}, must be at least 3")
    tree = source_tree("swimmer.xml")
    parent, sensors = tree.find("./worldbody/body"), tree.find("./sensor")
    if parent is None or sensors is None:
        raise ValueError("dm_control's swimmer.xml has no head or no sensors: this version of dm_control is not supported")
    make = type(tree)
    actuators = make("actuator")
    tree.append(actuators)
    limit = 360.0 / links
    for k in range(links - 1):
        child = make("body", name=f"segment_{k}", pos="0 .1 0")
        child.append(make("geom", {"class": "visual", "name": f"visual_{k}"}))
        child.append(make("geom", {"class": "inertial", "name": f"inertial_{k}"}))
        child.append(make("site", name=f"site_{k}"))
        child.append(make("joint", name=f"joint_{k}", range=f"{-limit} {limit}"))
        actuators.append(make("motor", name=f"motor_{k}", joint=f"joint_{k}"))
        sensors.append(make("velocimeter", name=f"velocimeter_{k}", site=f"site_{k}"))
        sensors.append(make("gyro", name=f"gyro_{k}", site=f"site_{k}"))
        parent.append(child)
        parent = child
    return load_quietly(tree)
