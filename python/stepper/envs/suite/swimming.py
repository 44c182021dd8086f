"""dm_control's fish and swimmer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_joints, reading, rotation, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.rotations import matrices
from stepper.shared.view import per_moment

_JOINTS = ("tail1", "tail_twist", "tail2", "finright_roll", "finright_pitch", "finleft_roll", "finleft_pitch")


@dataclass(frozen=True, kw_only=True)
class Fish(SuiteTask):
    """Task: turn upright, or swim to a target.

    Attributes:
        swim: Whether the task is to swim to a target.
    """

    file = "fish.xml"
    frame_skip: int = 10
    swim: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, cosine of the tilt, target in the frame of the mouth (only if the task is to swim), velocities: (24,) or (21,)."""
        return (
            Observation("joint_angles", func=_angles, unit="rad"),
            Observation("upright", func=lambda now: rotation(now, "torso")[:, 2, 2]),
            *([Observation("target", func=_mouth_to_target, unit="m")] if self.swim else []),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: a term for an upright torso.

        If the task is to swim, the score is the sum of 1/8 of this term and 7/8 of a term for the distance to the target.
        """
        upright = rotation(now, "torso")[:, 2, 2]
        if not self.swim:
            return tolerance(upright, 1.0, 1.0, margin=1.0)
        model = now.sim.model
        radii = float(model.geom("mouth").size[0] + model.geom("target").size[0])
        return (7.0 * tolerance(norm(_mouth_to_target(now)), 0.0, radii, margin=2.0 * radii) + 0.5 * (upright + 1.0)) / 8.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with a random orientation and small random angles; with `swim`, a random target in a box."""
        quat = reset.rng.normal(4)
        reset.qpos[:, 3:7] = quat / norm(quat)[:, None]
        model = self.model()
        for name in _JOINTS:
            at = model.joint(name).qposadr
            reset.qpos[:, at : at + 1] = reset.rng.uniform(-0.2, 0.2, 1)
        if self.swim:
            target = np.hstack([reset.rng.uniform(-0.4, 0.4, 2), reset.rng.uniform(0.1, 0.3, 1)])
            reset.sim.randomize({"geom_pos[target]": target}, envs=reset.envs)


def _angles(now: TaskView) -> Array:
    """Joint angles, (num_envs, 7), rad."""
    angles: Array = now.qpos[:, [now.sim.model.joint(name).qposadr for name in _JOINTS]]
    return angles


@per_moment
def _mouth_to_target(now: TaskView) -> Array:
    """Vector from the mouth to the target, in the frame of the mouth, m: (num_envs, 3)."""
    model = now.sim.model
    mouth = model.geom("mouth").id
    difference = now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, mouth]
    local: Array = np.einsum("ni,nij->nj", difference, matrices(now.geom_xquat[:, mouth]))
    return local


_TARGET_SIZE = 0.1
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
            Observation("to_target", func=_nose_to_target, unit="m"),
            Observation("body_velocities", func=_velocities, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the nose in the target, decreasing with the distance from it."""
        return tolerance(norm(_nose_to_target(now)), 0.0, _TARGET_SIZE, margin=5.0 * _TARGET_SIZE, fall="long_tail")

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random heading."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
        box = np.where(reset.rng.uniform(0.0, 1.0, 1) < 0.2, 0.3, 2.0)
        reset.sim.randomize({"geom_pos[target][0,1]": box * reset.rng.uniform(-1.0, 1.0, 2)}, envs=reset.envs)


@per_moment
def _nose_to_target(now: TaskView) -> Array:
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
