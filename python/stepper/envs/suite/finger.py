"""dm_control's finger: a planar finger that spins or turns a body on a hinge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_joints, randomize_without_overlap, reading, scene, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.view import per_moment

_FINGER = 0.01
"""Radius of the finger, m."""


@dataclass(frozen=True, kw_only=True)
class Reacher(SuiteTask):
    """Task: bring the finger to the target.

    Attributes:
        target_size: Radius of the target, m.
    """

    file = "reacher.xml"
    frame_skip: int = 1
    target_size: float = 0.05

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, vector from the finger to the target, joint velocities: (6,)."""
        return (
            Observation("position", func=lambda now: now.qpos, unit="rad"),
            Observation("to_target", func=_to_target, unit="m"),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the finger in the target, else 0."""
        return tolerance(norm(_to_target(now)), 0.0, self.target_size + _FINGER)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits. The target is 0.05 to 0.2 m from the base of the arm."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
        angle, radius = reset.rng.uniform(0.0, 2.0 * np.pi, 1), reset.rng.uniform(0.05, 0.2, 1)
        place = np.hstack([radius * np.sin(angle), radius * np.cos(angle)])
        reset.sim.randomize({"geom_pos[target][0,1]": place}, envs=reset.envs)


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the finger to the target, m: (num_envs, 2)."""
    model = now.sim.model
    difference: Array = (now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, model.geom("finger").id])[:, :2]
    return difference


_SPEED = 15.0
"""Angular speed above which the body counts as spinning, rad/s."""
_DAMPING = 0.03
"""Damping of the hinge of the body in the spinning task, N m s/rad."""


@dataclass(frozen=True, kw_only=True)
class Finger(SuiteTask):
    """Task: keep a body on a hinge spinning, by pushing it with a planar finger."""

    file = "finger.xml"
    frame_skip: int = 2

    def model(self) -> Model:
        """Model of the scene, with a smaller damping of the hinge than in the file."""
        model = scene(self.file)
        damping = np.array(model.dof_damping)
        damping[model.joint("hinge").dofadr] = _DAMPING
        return model.replace(dof_damping=damping)

    def observations(self) -> tuple[Observation, ...]:
        """Angles of the finger, tip of the body relative to the hinge, velocities, and log(1 + force) at the finger's two pads: (9,)."""
        return (
            Observation("angles", func=lambda now: reading(now, "proximal", "distal"), unit="rad"),
            Observation("tip", func=lambda now: _relative_to_hinge(now, "tip"), unit="m"),
            Observation("velocity", func=lambda now: reading(now, "proximal_velocity", "distal_velocity", "hinge_velocity"), unit="rad/s"),
            Observation("touch", func=lambda now: np.log1p(reading(now, "touchtop", "touchbottom")), unit="log(1 + N)"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 if the body spins at 15 rad/s or faster in the negative direction of the hinge, else 0."""
        spins: Array = (reading(now, "hinge_velocity")[:, 0] <= -_SPEED).astype(np.float64)
        return spins

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits, without contacts."""
        randomize_without_overlap(scene(self.file), reset.qpos, reset.rng)


@dataclass(frozen=True, kw_only=True)
class FingerTurn(Finger):
    """Task: turn a body on a hinge until the tip of the body is in the target.

    The target is a mocap body, with a random position in each episode.

    Attributes:
        target_size: Radius of the target, m.
    """

    target_size: float

    def model(self) -> Model:
        """Model of the scene, with the target as a mocap body."""
        return _scene_with_target()

    def observations(self) -> tuple[Observation, ...]:
        """Observations of `Finger`, target relative to the hinge, and distance from the tip to the surface of the target: (12,)."""
        return (
            *super().observations(),
            Observation("target_position", func=lambda now: _relative_to_hinge(now, "target"), unit="m"),
            Observation("dist_to_target", func=self._distance, unit="m"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the tip in the target, else 0."""
        inside: Array = (self._distance(now) <= 0.0).astype(np.float64)
        return inside

    def reset(self, reset: Reset) -> None:
        """Initial states of `Finger`, and a random target on the circle on which the tip of the body moves."""
        super().reset(reset)
        model, angle = reset.sim.model, reset.rng.uniform(-np.pi, np.pi, 1)[:, 0]
        offsets = model.geom("cap1").size.sum() * np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
        reset.mocap_pos[:, model.body("target").mocapid] = model.body("spinner").pos + offsets

    def _distance(self, now: TaskView) -> Array:
        """Distance from the tip of the body to the surface of the target, negative inside, m: (num_envs,)."""
        return norm(_relative_to_hinge(now, "target") - _relative_to_hinge(now, "tip")) - self.target_size


def _relative_to_hinge(now: TaskView, sensor: str) -> Array:
    """Reading of a position sensor minus the position of the hinge, in x and z, m: (num_envs, 2)."""
    offset: Array = (reading(now, sensor) - reading(now, "spinner"))[:, ::2]
    return offset


@cache_model
def _scene_with_target() -> Model:
    """Model of dm_control's finger, with the site "target" in a mocap body, so that resets can move it."""
    tree = source_tree("finger.xml")
    world = tree.find("worldbody")
    site = None if world is None else world.find("site[@name='target']")
    if world is None or site is None:
        raise ValueError("finger.xml has no site 'target' in its worldbody: this version of dm_control is not supported")
    world.remove(site)
    body = type(tree)("body", name="target", mocap="true", pos=site.attrib.pop("pos"))
    body.append(site)
    world.append(body)
    return load_quietly(tree)
