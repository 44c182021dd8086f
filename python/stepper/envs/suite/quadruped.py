"""dm_control's quadruped, on flat ground and in bowls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly, remove_elements
from stepper.envs.observations import Observation
from stepper.envs.suite.base import (
    SuiteTask,
    hinges,
    lift_until_free,
    norm,
    open_floor,
    reading,
    rotation,
    source_tree,
    tolerance,
)
from stepper.envs.task import Array, Reset, TaskView
from stepper.envs.terrain import SubTerrain, Terrain
from stepper.shared.rotations import about_vertical

_TOES = ("front_left", "front_right", "back_right", "back_left")
_EPISODE = 20.0
"""Duration of an episode, s."""
_ARENA = 15.0
"""Half the side of the arena in which the ball is fetched, m."""
_BALL = {("body", "ball"), ("site", "target")}
"""Elements of the file that belong to the ball: tag and name of each."""
_WORKSPACE, _TARGET = 0.3, 0.4
"""Radius of the zone in front of the robot within which the ball counts as reached, and radius of the target, m."""
_BOWL, _FLOOR, _TILES = 30.0, 40.0, 4
"""Half sides of the tile around a bowl and of the floor below, m, and number of tiles in each direction."""


@dataclass(frozen=True, kw_only=True)
class Quadruped(SuiteTask):
    """Task: move forwards, fetch a ball, or escape from a bowl with bumps.

    To escape means to get 30 m away from the middle of a bowl, which is at the origin. The terrain has 16 bowls on square tiles. A reset
    draws one of them for the episode, and moves the height field so that its middle is at the origin.

    Sensors are those of stepper. The accelerometer and the touch sensors of the toes use the mean acceleration (v+ - v) / h over the last
    step, in the pose after it. The sensors of dm_control use the acceleration before that step, without implicit joint damping.

    Attributes:
        move_speed: Forward speed that earns the full reward of 1, m/s.
        fetch: Whether the task is to bring a ball to the middle.
        escape: Whether the task is to escape; then `move_speed` and `fetch` have no effect.
        model_seed: Seed of the bowls.
    """

    file = "quadruped.xml"
    frame_skip: int = 4
    move_speed: float = 0.5
    fetch: bool = False
    escape: bool = False
    model_seed: int = 0

    def model(self) -> Model:
        """Model of the scene, with terrain and range finders if the task is to escape.

        In other tasks without a ball, half the side of the floor is the distance that the robot covers in an episode at the rewarded speed.
        """
        if self.escape:
            return _scene(_FLOOR, self.model_seed)
        return _scene(None if self.fetch else self.move_speed * _EPISODE, None)

    def observations(self) -> tuple[Observation, ...]:
        """Angles and velocities of the hinges, activations, state of the torso, and forces and torques at the toes: (78,).

        The state of the torso is its velocity, the vertical component of its z axis, and the readings of its accelerometer and gyro. If the
        task is to fetch, the states of ball and target follow: (90,). If it is to escape, the position of the origin and the hyperbolic
        tangents of the readings of 20 range finders follow: (101,).
        """
        rows = (
            Observation("egocentric_state", func=_egocentric_state, unit="rad, rad/s"),
            Observation("torso_velocity", func=lambda now: reading(now, "velocimeter"), unit="m/s"),
            Observation("torso_upright", func=lambda now: rotation(now, "torso")[:, 2, 2]),
            Observation("accelerometer", func=lambda now: reading(now, "imu_accel"), unit="m/s^2"),
            Observation("gyro", func=lambda now: reading(now, "imu_gyro"), unit="rad/s"),
            Observation("force_torque", func=_at_the_toes, unit="arsinh(N), arsinh(N m)"),
        )
        if self.escape:
            origin = Observation("origin", func=lambda now: _local(now, 0.0), unit="m")
            return (*rows, origin, Observation("rangefinder", func=_distances, unit="tanh(m)"))
        if not self.fetch:
            return rows
        target = Observation("target_position", func=lambda now: _local(now, now.site_xpos[:, now.sim.model.site("target").id]), unit="m")
        return (*rows, Observation("ball_state", func=_ball, unit="m, m/s, rad/s"), target)

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for an upright torso, and for speed, distance from the origin, or the positions of robot and ball."""
        vertical = np.cos(np.deg2rad(20.0)) if self.escape else 1.0
        upright = tolerance(rotation(now, "torso")[:, 2, 2], vertical, float("inf"), margin=1.0 + vertical, fall="linear", value=0.0)
        if self.escape:
            distance = norm(now.site_xpos[:, now.sim.model.site("workspace").id])
            return upright * tolerance(distance, _BOWL, float("inf"), margin=_BOWL, fall="linear", value=0.0)
        if not self.fetch:
            speed, wanted = reading(now, "velocimeter")[:, 0], self.move_speed
            return upright * tolerance(speed, wanted, float("inf"), margin=wanted, fall="linear", value=0.5)
        model, ball = now.sim.model, _body_position(now, "ball")
        radii = {"workspace": _WORKSPACE + float(model.geom("ball").size[0]), "target": _TARGET}
        distances = {site: norm((now.site_xpos[:, model.site(site).id] - ball)[:, :2]) for site in radii}
        near, brought = (
            tolerance(distances[site], 0.0, radius, margin=np.sqrt(2.0) * _ARENA, fall="linear", value=0.0)
            for site, radius in radii.items()
        )
        reward: Array = upright * near * (0.5 + 0.5 * brought)
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest just above the ground, or the middle of a random bowl, with a random orientation.

        If the task is to fetch, the robot starts upright with a random heading, and the ball is in flight.
        """
        model = self.model()
        at = model.joint("root").qposadr
        if self.escape or not self.fetch:
            quat = reset.rng.normal(4)
            reset.qpos[:, at + 3 : at + 7] = quat / norm(quat)[:, None]
            if self.escape:
                middles = 2.0 * _BOWL * (np.floor(reset.rng.uniform(0.0, _TILES, 2)) - 0.5 * (_TILES - 1))
                reset.qpos[:, at : at + 2] = middles
                reset.sim.randomize({"geom_pos[terrain][0,1]": -middles}, envs=reset.envs)
            lift_until_free(model, reset.qpos, at + 2)
            reset.qpos[:, at : at + 2] = 0.0
            return
        reset.qpos[:, at + 3 : at + 7] = about_vertical(reset.rng.uniform(0.0, 2.0 * np.pi, 1)[:, 0])
        reset.qpos[:, at : at + 2] = reset.rng.uniform(-0.9 * _ARENA, 0.9 * _ARENA, 2)
        lift_until_free(model, reset.qpos, at + 2)
        ball = model.joint("ball_root")
        reset.qpos[:, ball.qposadr : ball.qposadr + 2] = reset.rng.uniform(-0.9 * _ARENA, 0.9 * _ARENA, 2)
        reset.qpos[:, ball.qposadr + 2] = 2.0
        reset.qvel[:, ball.dofadr : ball.dofadr + 2] = 5.0 * reset.rng.normal(2)


@dataclass(frozen=True, kw_only=True)
class _Bowl(SubTerrain):
    """dm_control's bowl: a ring of hills with bumps."""

    def heights(self, x: Array, y: Array, size: float, difficulty: float, rng: np.random.Generator) -> Array:
        """Returns the heights at points of a tile, (ny, nx), m."""
        from scipy import ndimage  # noqa: PLC0415 - dm_control needs it, stepper does not

        radius = np.clip(np.hypot(x, y[:, None]) / _BOWL, 0.04, 1.0)
        bumps = ndimage.zoom(rng.uniform(0.15, 1.0, (30, 30)), len(x) / 30.0)
        return np.asarray(5.0 * (0.5 - 0.5 * np.cos(2.0 * np.pi * radius)) * bumps)


def _egocentric_state(now: TaskView) -> Array:
    """Angles and velocities of the hinges, activations: (num_envs, 44)."""
    joints = hinges(now.sim.model)
    angles, rates = now.qpos[:, [joint.qposadr for joint in joints]], now.qvel[:, [joint.dofadr for joint in joints]]
    return np.concatenate([angles, rates, now.act], axis=1)


def _at_the_toes(now: TaskView) -> Array:
    """Inverse hyperbolic sines of the forces (N) and torques (N m) measured at the toes: (num_envs, 24)."""
    loads: Array = np.arcsinh(reading(now, *(f"{kind}_toe_{toe}" for kind in ("force", "torque") for toe in _TOES)))
    return loads


def _ball(now: TaskView) -> Array:
    """Position, velocity and angular velocity of the ball, one per row, in the frame of the torso: (num_envs, 3, 3).

    Position (m) and velocity (m/s) are relative to the torso. The angular velocity (rad/s) is rotated as in dm_control, which treats its
    components in the frame of the ball (`qvel`) as components in world axes.
    """
    ball, root = now.sim.model.joint("ball_root").dofadr, now.sim.model.joint("root").dofadr
    rows = [
        _body_position(now, "ball") - _body_position(now, "torso"),
        now.qvel[:, ball : ball + 3] - now.qvel[:, root : root + 3],
        now.qvel[:, ball + 3 : ball + 6],
    ]
    state: Array = np.einsum("nki,nij->nkj", np.stack(rows, axis=1), rotation(now, "torso"))
    return state


def _local(now: TaskView, place: Array | float) -> Array:
    """Position of a place (num_envs, 3), m, relative to the torso and in its frame, (num_envs, 3), m. The place 0.0 is the origin."""
    local: Array = np.einsum("ni,nij->nj", place - _body_position(now, "torso"), rotation(now, "torso"))
    return local


def _distances(now: TaskView) -> Array:
    """Hyperbolic tangents of the distances (m) that the range finders read, (num_envs, 20); 1 if a ray hits nothing."""
    distances = reading(now, *(f"rf_{row}{column}" for row in range(4) for column in range(5)))
    return np.where(distances == -1.0, 1.0, np.tanh(distances))


def _body_position(now: TaskView, body: str) -> Array:
    """Position of a body by name, in world axes, (num_envs, 3), m."""
    place: Array = now.xpos[:, now.sim.model.body(body).id]
    return place


@cache_model
def _scene(floor: float | None, seed: int | None) -> Model:
    """Model of the quadruped on a square floor without walls and ball.

    `floor` is half the side of the floor, m. None keeps the arena with walls and ball. `seed` is that of the terrain, which is 1 cm below
    the floor as in dm_control. None removes terrain and range finders.
    """
    unwanted = ["hfield"] if seed is not None else ["hfield", "rangefinder"]
    tree = remove_elements(source_tree(Quadruped.file), lambda element: element.tag in unwanted or element.get("type") == "hfield")
    if seed is not None:
        kinds = {f"column_{k}": _Bowl() for k in range(_TILES)}
        bowls = Terrain(sub_terrains=kinds, num_rows=_TILES, size=2.0 * _BOWL, horizontal_scale=0.3, border_width=0.0, seed=seed)
        field, surface = bowls.elements(pos=f"0 0 {bowls.elevation.min() - 0.01}")
        next(tree.iter("asset")).append(field)
        next(tree.iter("worldbody")).append(surface)
    return load_quietly(tree if floor is None else open_floor(tree, floor, _BALL))
