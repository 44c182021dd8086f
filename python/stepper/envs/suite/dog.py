"""dm_control's dog, which stands, moves forwards or fetches a ball."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import cache_model, cache_per_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, hinges, norm, open_floor, reading, rotation, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.machine import package_file
from stepper.shared.rotations import about_vertical, matrices
from stepper.shared.view import per_moment

_EPISODE = 15.0
"""Duration of an episode, s."""
_ARENA = 10.0
"""Half the side of the arena in which the ball is fetched, m."""
_UPRIGHT = np.cos(np.deg2rad(30.0))
"""Cosine of the largest tilt of skull, torso and pelvis with full reward."""
_STANDING = 0.9
"""Heights of torso and pelvis above which the dog counts as standing, as a fraction of their heights in the reference pose."""
_BITE = 0.005
"""Distance of the ball from the jaws below which it counts as in the mouth, m."""
_BALL = {("body", "ball"), ("geom", "target"), ("camera", "ball"), ("camera", "head")}
"""Tag and name of the elements of the file that belong to the ball."""
_FEET = ("foot_L", "foot_R", "hand_L", "hand_R")
_SOLES = ("palm_L", "palm_R", "sole_L", "sole_R")


@dataclass(frozen=True, kw_only=True)
class Dog(SuiteTask):
    """Task: stand, move forwards, or fetch a ball.

    Sensors are those of stepper and differ from dm_control's. The accelerometer and the forces at the feet use the mean acceleration over
    the last step, as in `Quadruped`. The touch sensor of a sole counts contacts of the last step within its volume after the step;
    dm_control uses the volume before the step. This difference changes the reward by up to a tenth while a foot moves. Muscle forces act
    from the first observation of an episode on; in dm_control they start one step later.

    Attributes:
        move_speed: Forward speed that earns the full reward of 1, m/s; 0 to stand.
        fetch: Whether the task is to bring a ball to the middle.
    """

    file = "dog.xml"
    frame_skip: int = 3
    move_speed: float = 0.0
    fetch: bool = False

    def model(self) -> Model:
        """Model of the scene.

        In tasks without a ball, half the side of the floor is the distance that the robot covers in an episode at the rewarded speed. If
        the task is to stand, it is the distance at 1 m/s.
        """
        return _scene(None if self.fetch else _EPISODE * (self.move_speed or 1.0))

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (223,): joints, torso and pelvis, sensors and activations. With `fetch`, ball and target follow: (232,).

        The first rows are angles and velocities of the joints, and heights of torso and pelvis. The vertical direction in the frames of
        skull, torso and pelvis, and the velocity of the centre of mass follow. The last rows are readings of inertial, force and touch
        sensors, and activations.
        """
        rows = (
            Observation("joint_angles", func=lambda now: now.qpos[:, [joint.qposadr for joint in hinges(now.sim.model)]], unit="rad"),
            # The spelling is that of dm_control.
            Observation("joint_velocites", func=lambda now: now.qvel[:, [joint.dofadr for joint in hinges(now.sim.model)]], unit="rad/s"),
            Observation("torso_pelvis_height", func=_heights, unit="m"),
            Observation("z_projection", func=_verticals),
            Observation("torso_com_velocity", func=_velocity, unit="m/s"),
            Observation(
                "inertial_sensors", func=lambda now: reading(now, "accelerometer", "velocimeter", "gyro"), unit="m/s^2, m/s, rad/s"
            ),
            Observation("foot_forces", func=lambda now: reading(now, *_FEET), unit="N"),
            Observation("touch_sensors", func=lambda now: reading(now, *_SOLES), unit="N"),
            Observation("actuator_state", func=lambda now: now.act),
        )
        return (
            (*rows, Observation("ball_state", func=_ball, unit="m, m/s"), Observation("target_position", func=_target, unit="m"))
            if self.fetch
            else rows
        )

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for height, upright posture and feet on the ground, and for speed or the position of the ball."""
        heights, weight = _standing(now.sim.model)
        high = tolerance(_heights(now), heights, float("inf"), margin=heights)
        upright = tolerance(_verticals(now)[:, :, 2], _UPRIGHT, float("inf"), margin=_UPRIGHT + 1.0, fall="linear", value=0.0)
        force = reading(now, *_SOLES).sum(axis=1)
        supported = tolerance(force, weight, float("inf"), margin=weight, fall="linear", value=0.9)
        reward: Array = high.prod(axis=1) * upright.prod(axis=1) * supported
        if self.fetch:
            return reward * _fetching(now)
        if self.move_speed:
            wanted = self.move_speed
            speed = tolerance(_velocity(now)[:, 0], wanted, 2.0 * wanted, margin=max(1.0, wanted), fall="linear", value=0.0)
            return reward * (4.0 * speed + 1.0) / 5.0
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: standing, with a random heading and velocity, and random activations within the bounds of the controls."""
        model = reset.sim.model
        root = model.joint("root")
        reset.qpos[:, root.qposadr + 3 : root.qposadr + 7] = about_vertical(reset.rng.uniform(0.0, 2.0 * np.pi, 1)[:, 0])
        reset.qvel[:, [root.dofadr, root.dofadr + 1, root.dofadr + 5]] = 2.0 * reset.rng.normal(3)
        if self.fetch:
            self._throw(reset)
        low, high = model.actuator_ctrlrange.T
        reset.act = low + (high - low) * reset.rng.uniform(0.0, 1.0, len(low))

    def _throw(self, reset: Reset) -> None:
        """Draws initial states of the ball, which flies from a random direction towards the middle of the arena."""
        model = reset.sim.model
        ball = model.joint("ball_root")
        azimuth, height, speed = reset.rng.uniform(0.0, 2.0 * np.pi, 1), reset.rng.uniform(0.0, 3.0, 1), reset.rng.uniform(0.0, 5.0, 1)
        outwards = np.hstack([np.sin(azimuth), np.cos(azimuth)])
        reset.qpos[:, ball.qposadr : ball.qposadr + 3] = np.hstack([0.75 * _ARENA * outwards, np.full_like(azimuth, 0.05)])
        rising = np.sqrt(-2.0 * model.gravity[2] * height)
        reset.qvel[:, ball.dofadr : ball.dofadr + 3] = np.hstack([speed * (0.05 * reset.rng.normal(2) - outwards), rising])


@cache_per_model
def _standing(model: Model) -> tuple[Array, float]:
    """Heights of torso and pelvis above which the dog counts as standing, (2,) m; and the weight of the dog, N."""
    rest = Stepper(model, 1)
    heights = np.asarray(rest.xpos)[0, [model.body(name).id for name in ("torso", "pelvis")], 2]
    mass = float(sum(body.mass for body in map(model.body, range(model.nbody)) if body.name != "ball"))
    return _STANDING * heights, -mass * float(model.gravity[2])


def _heights(now: TaskView) -> Array:
    """Heights of torso and pelvis, m: (num_envs, 2)."""
    heights: Array = now.xpos[:, [now.sim.model.body(name).id for name in ("torso", "pelvis")], 2]
    return heights


@per_moment
def _verticals(now: TaskView) -> Array:
    """World's vertical unit vector in the frames of skull, torso and pelvis, one row each: (num_envs, 3, 3)."""
    return np.stack([rotation(now, body)[:, 2] for body in ("skull", "torso", "pelvis")], axis=1)


@per_moment
def _velocity(now: TaskView) -> Array:
    """Velocity of the centre of mass, in the frame of the torso, m/s: (num_envs, 3)."""
    velocity: Array = np.einsum("nk,nkj->nj", reading(now, "torso_linvel"), rotation(now, "torso"))
    return velocity


def _ball(now: TaskView) -> Array:
    """Position (m) and velocity (m/s) of the ball relative to the head, in the frame of the head, one per row: (num_envs, 2, 3)."""
    model = now.sim.model
    head, ball = model.site("head"), model.joint("ball_root").dofadr
    arm = now.site_xpos[:, head.id] - now.xpos[:, head.bodyid]
    velocity = now.body_linvel[:, head.bodyid] + np.cross(now.body_angvel[:, head.bodyid], arm)
    return _to_head(now, np.stack([_from_head(now, "ball"), now.qvel[:, ball : ball + 3] - velocity], axis=1))


def _target(now: TaskView) -> Array:
    """Vector from the head to the target, in the frame of the head, m: (num_envs, 1, 3)."""
    return _to_head(now, _from_head(now, "target")[:, None])


def _from_head(now: TaskView, geom: str) -> Array:
    """Vector from the dog's head to a geom, in world axes, (num_envs, 3), m."""
    offset: Array = _geom_position(now, geom) - now.site_xpos[:, now.sim.model.site("head").id]
    return offset


def _to_head(now: TaskView, vectors: Array) -> Array:
    """Components of world vectors, (num_envs, n, 3), in the frame of the dog's head."""
    local: Array = vectors @ matrices(now.site_xquat[:, now.sim.model.site("head").id])
    return local


def _geom_position(now: TaskView, geom: str) -> Array:
    """Position of a geom, (num_envs, 3), m."""
    place: Array = now.geom_xpos[:, now.sim.model.geom(geom).id]
    return place


def _fetching(now: TaskView) -> Array:
    """Score of fetching, (num_envs,): product of a term for the ball in the mouth and a term for the ball at the target.

    The first term is 1 if the ball is within two target radii of the target.
    """
    model = now.sim.model
    ball, radius = _geom_position(now, "ball"), float(model.geom("target").size[0])
    upper, lower = (norm(ball - now.site_xpos[:, model.site(site).id]) for site in ("upper_bite", "lower_bite"))
    to_mouth = 0.5 * (upper + lower)
    to_target = norm(ball - _geom_position(now, "target"))
    reached = (6.0 * tolerance(to_mouth, 0.0, _BITE, margin=2.0, fall="reciprocal") + 1.0) / 7.0
    brought = (tolerance(to_target, 0.0, radius, margin=_ARENA, fall="reciprocal") + 1.0) / 2.0
    fetching: Array = np.where(to_target < 2.0 * radius, 1.0, reached) * brought
    return fetching


@cache_model
def _scene(floor: float | None) -> Model:
    """Model of the dog on a square floor without walls and ball. `floor` is half the side, m; None keeps the arena with walls and ball."""
    tree = source_tree(Dog.file)
    assets = package_file("dm_control", "suite/dog_assets", "for tasks of its suite, whose models it has")
    for compiler in tree.iter("compiler"):
        compiler.set("meshdir", assets)
        compiler.set("texturedir", assets)
    return load_quietly(tree if floor is None else open_floor(tree, floor, _BALL))
