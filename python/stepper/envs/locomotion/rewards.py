"""Terms of the rewards of legged robots, without their weights. Each function returns one number per environment, (num_envs,)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.contacts import contact_forces
from stepper.envs.quantities import base_angvel, base_linvel, gravity, heading, in_base, joint_pos, site_linvel, sites_of
from stepper.envs.task import Array, TaskView, square_sum
from stepper.shared.view import per_moment

SCAN = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.5, 0.5, 11), indexing="ij"), axis=-1).reshape(-1, 2)
"""Points of the height scan relative to the base, ahead and to the left, (187, 2) m."""
_SLOPE_WEIGHTS = SCAN / (SCAN**2).sum(axis=0)
"""Matrix from scanned heights to the slopes (ahead, left) of the plane that fits them best, (187, 2) 1/m."""
_SOFT = 0.9
"""Width of a joint's soft range as a fraction of its range."""
_MOVES, _RUNS = 0.05, 1.5
"""Smallest speed of a command to walk, and smallest speed of a command to run: m/s plus rad/s, as `_speed` computes it."""
_HEIGHT = 0.1
"""Target height of a swinging foot above the ground, m."""
_AIR_TIMES = (0.05, 0.5)
"""Shortest and longest time in the air for which a foot is rewarded, s."""
_MOVES_FAST = 0.5
"""Speed of a command (m/s plus rad/s) above which feet are rewarded for their time in the air."""
_COLLISION_FORCE = 10.0
"""Normal force above which a contact of a thigh, shank or trunk counts as a collision, N."""


def tracking_error(now: TaskView) -> Array:
    """Norm of the difference of the base's velocity in x and y from the command, (num_envs,), m/s."""
    error: Array = np.sqrt(square_sum(base_linvel(now)[:, :2] - now.command()[:, :2]))
    return error


def track_linear_velocity(now: TaskView, *, vertical: bool = True) -> Array:
    """Agreement of the base's linear velocity with the command, from 0 to 1, (num_envs,).

    With `vertical`, the z velocity should be 0.
    """
    velocity = base_linvel(now)
    error = square_sum(now.command()[:, :2] - velocity[:, :2])
    return np.exp(-(error + np.square(velocity[:, 2]) if vertical else error) / 0.25)


def track_angular_velocity(now: TaskView, *, variance: float = 0.5, tilting: bool = True) -> Array:
    """Agreement of the base's angular velocity with the command, from 0 to 1, (num_envs,).

    With `tilting`, the rates about x and y should be 0. `variance` is the squared difference at which the term is 1/e, (rad/s)^2.
    """
    rates = base_angvel(now)
    error = np.square(now.command()[:, 2] - rates[:, 2])
    agreement: Array = np.exp(-(error + square_sum(rates[:, :2]) if tilting else error) / variance)
    return agreement


def vertical_velocity(now: TaskView) -> Array:
    """Squared velocity of the base along its z axis, (num_envs,), m^2/s^2."""
    return np.square(base_linvel(now)[:, 2])


def body_ang_vel(now: TaskView) -> Array:
    """Squared angular velocity of the base about its x and y axes, (num_envs,), rad^2/s^2."""
    return square_sum(base_angvel(now)[:, :2])


def flat_orientation(now: TaskView) -> Array:
    """Squared sine of the tilt of the base, from 0 to 1, (num_envs,)."""
    return square_sum(gravity(now)[:, :2])


def joint_deviation(now: TaskView) -> Array:
    """Squared norm of the differences of the joint angles from the stance, (num_envs,), rad^2."""
    return square_sum(joint_pos(now))


def joint_torques(now: TaskView) -> Array:
    """Squared norm of the actuator forces, (num_envs,), N^2 m^2."""
    return square_sum(now.actuator_force)


def set_point_rate(now: TaskView) -> Array:
    """Squared norm of the change of the servos' set points by the last action, (num_envs,), rad^2."""
    return square_sum(action_scale(now.sim.model) * (now.action - now.previous_action))


def stride(now: TaskView) -> Array:
    """Time in the air of feet that just landed, beyond 0.1 s and up to 0.3 s, (num_envs,), s; 0 if the command is to stand."""
    strides: Array = now.episode_state["stride"] * (square_sum(now.command()) > 0.01)
    return strides


def upright(now: TaskView) -> Array:
    """Agreement of the base's z axis with the normal of the scanned ground, from 0 to 1, (num_envs,)."""
    return np.exp(-square_sum(ground_normal(now)[:, :2]) / 0.2)


def pose(now: TaskView) -> Array:
    """Agreement of the joint angles with the stance, from 0 to 1, (num_envs,).

    The tolerances of the angles (`STANDING`, `WALKING` and `RUNNING` of the task) depend on the speed of the command.
    """
    stand, walk, run = _tolerances(now.sim.model, type(now.task))
    speed = _speed(now)[:, None]
    tolerance = np.where(speed < _MOVES, stand, np.where(speed < _RUNS, walk, run))
    agreement: Array = np.exp(-square_sum(joint_pos(now) / tolerance) / now.sim.model.nu)
    return agreement


def dof_pos_limits(now: TaskView) -> Array:
    """Sum of the angles by which joints exceed their soft limits, (num_envs,), rad."""
    low, high = _soft_limits(now.sim.model)
    angles = now.qpos[:, 7:]
    beyond: Array = np.einsum("ij->i", np.maximum(low - angles, 0.0) + np.maximum(angles - high, 0.0))
    return beyond


def foot_clearance(now: TaskView) -> Array:
    """Sum over the feet of |height - target height| times horizontal speed, (num_envs,), m^2/s; 0 if the command is to stand."""
    return _moving(now, np.abs(foot_heights(now) - _HEIGHT) * foot_speeds(now))


def foot_swing_height(now: TaskView) -> Array:
    """Sum of (greatest height of the swing / target height - 1)^2 over the feet that just landed, (num_envs,), without unit.

    It is 0 if the command is to stand.
    """
    state = now.episode_state
    return _moving(now, np.square(state["swing"] / _HEIGHT - 1.0) * state["landed"])


def air_time(now: TaskView) -> Array:
    """Number of feet that have been in the air for 0.05 to 0.5 s, (num_envs,).

    It is 0 if the commanded speed (m/s, plus the rate of turn in rad/s) is 0.5 or less.
    """
    time = now.episode_state["air_time"]
    count: Array = ((time > _AIR_TIMES[0]) & (time < _AIR_TIMES[1])).sum(axis=1) * (_speed(now) > _MOVES_FAST)
    return count


def foot_slip(now: TaskView) -> Array:
    """Sum of the squared horizontal speeds of feet on the ground, (num_envs,), m^2/s^2; 0 if the command is to stand."""
    return _moving(now, np.square(foot_speeds(now)) * (foot_forces(now) > 0.0))


def soft_landing(now: TaskView) -> Array:
    """Sum of the normal forces on feet that just landed, (num_envs,), N; 0 if the command is to stand."""
    return _moving(now, foot_forces(now) * now.episode_state["landed"])


def collision(now: TaskView, *, part: str) -> Array:
    """Number of time steps of the action if a part of the robot collides with the terrain in the last of them, else 0, (num_envs,).

    Args:
        now: View of the batch.
        part: Attribute of the task with the names of the part's geoms: "SHANKS" or "TRUNK".
    """
    count: Array = now.task.frame_skip * touches_terrain(now, getattr(now.task, part)).astype(np.float64)
    return count


def touches_terrain(now: TaskView, geoms: tuple[str, ...]) -> Array:
    """Whether at least one of the geoms pressed on the terrain with more than 10 N in the last time step: (num_envs,) bool."""
    if not geoms:
        return np.zeros(len(now.action), dtype=bool)
    return np.asarray(np.any(contact_forces(now, geoms, ["terrain"]) > _COLLISION_FORCE, axis=1))


@per_moment
def _speed(now: TaskView) -> Array:
    """Speed of the velocity command, (num_envs,): horizontal speed in m/s plus the absolute rate of turn in rad/s."""
    wanted = now.command()
    speed: Array = np.hypot(wanted[:, 0], wanted[:, 1]) + np.abs(wanted[:, 2])
    return speed


def _moving(now: TaskView, costs: Array) -> Array:
    """Sum over the feet of costs (num_envs, nfeet), 0 in environments whose command is to stand: (num_envs,)."""
    # einsum, because np.sum would add the costs in another order for a single environment, with other rounding.
    sums: Array = np.einsum("ij->i", costs) * (_speed(now) > _MOVES)
    return sums


@per_moment
def ground_scan(now: TaskView) -> Array:
    """Heights of the ground at the points of the scan, which turns with the heading of the base: (num_envs, 187) m."""
    scan: Array = now.task.ground.ground.around(now.qpos[:, :2], heading(now), SCAN, beyond=0.0)
    return scan


@per_moment
def ground_normal(now: TaskView) -> Array:
    """Unit vector normal to the plane that fits the scanned ground best, in the frame of the base, (num_envs, 3)."""
    slopes = np.einsum("nk,ki->ni", ground_scan(now), _SLOPE_WEIGHTS)
    c, s = np.cos(heading(now)), np.sin(heading(now))
    normal = np.stack([s * slopes[:, 1] - c * slopes[:, 0], -s * slopes[:, 0] - c * slopes[:, 1], np.ones(len(c))], axis=1)
    return in_base(now, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None])


@per_moment
def foot_heights(now: TaskView) -> Array:
    """Heights of the feet's sites above the ground: (num_envs, nfeet) m."""
    places = now.site_xpos[:, sites_of(now.model, tuple(now.task.FEET))[0]]
    heights: Array = places[..., 2] - now.task.ground_height(places[..., :2])
    return heights


@per_moment
def foot_speeds(now: TaskView) -> Array:
    """Horizontal speeds of the feet's sites: (num_envs, nfeet) m/s."""
    velocity = site_linvel(now, tuple(now.task.FEET))
    speeds: Array = np.hypot(velocity[..., 0], velocity[..., 1])
    return speeds


@per_moment
def foot_forces(now: TaskView) -> Array:
    """Normal forces between the feet and the terrain in the last time step: (num_envs, nfeet) N."""
    geoms = now.task.FEET.values()
    forces = contact_forces(now, [name for names in geoms for name in names], ["terrain"])
    ends = np.cumsum([0, *map(len, geoms)])
    return np.stack([forces[:, a:b].sum(axis=1) for a, b in pairwise(ends)], axis=1)


@cache_per_model
def action_scale(model: Model) -> Array:
    """Change of a servo's set point by an action of 1: (nu,) rad. It gives a quarter of the largest torque, as in mjlab."""
    scale: Array = model.actuator_forcerange[:, 1] / (4.0 * model.actuator_gainprm[:, 0])
    return scale


@cache_per_model
def _tolerances(model: Model, task: type) -> tuple[Array, Array, Array]:
    """Tolerances of the joint angles for commands to stand, to walk and to run: (nu,) rad each."""
    tables: tuple[Mapping[str, float], ...] = (task.STANDING, task.WALKING, task.RUNNING)  # type: ignore[attr-defined]
    names = model.joint_names[1:]
    found = [np.array([next(v for pattern, v in table.items() if re.search(pattern, name)) for name in names]) for table in tables]
    return found[0], found[1], found[2]


@cache_per_model
def _soft_limits(model: Model) -> tuple[Array, Array]:
    """Lower and upper soft limits of the joints: (nu,) rad each."""
    low, high = np.asarray(model.jnt_range)[1:].T
    middle, half = 0.5 * (low + high), 0.5 * _SOFT * (high - low)
    return middle - half, middle + half
