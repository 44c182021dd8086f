"""Unweighted terms of the reward of mjlab's velocity tasks. Each function returns one number per environment, (num_envs,)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.contacts import contact_forces
from stepper.envs.locomotion.base import linear_velocity, stance
from stepper.envs.locomotion.rough.commands import command
from stepper.envs.locomotion.rough.state import foot_forces, foot_heights, foot_speeds, ground_normal
from stepper.envs.task import Array, Moment, Terms, per_moment, square_sum

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


@per_moment
def _speed(now: Moment) -> Array:
    """Speed of the velocity command, (num_envs,): horizontal speed in m/s plus the absolute rate of turn in rad/s."""
    wanted = command(now)
    speed: Array = np.hypot(wanted[:, 0], wanted[:, 1]) + np.abs(wanted[:, 2])
    return speed


def _linear(now: Moment) -> Array:
    """Reward term: agreement of the base's linear velocity with the command, from 0 to 1, (num_envs,). The z velocity should be 0."""
    velocity = linear_velocity(now)
    error = square_sum(command(now)[:, :2] - velocity[:, :2]) + np.square(velocity[:, 2])
    return np.exp(-error / 0.25)


def _angular(now: Moment) -> Array:
    """Reward term: agreement of the base's angular velocity with the command, from 0 to 1, (num_envs,). About x and y it should be 0."""
    rates = now.qvel[:, 3:6]
    error = np.square(command(now)[:, 2] - rates[:, 2]) + square_sum(rates[:, :2])
    reward: Array = np.exp(-error / 0.5)
    return reward


def _upright(now: Moment) -> Array:
    """Reward term: agreement of the base's z axis with the normal of the scanned ground, from 0 to 1, (num_envs,)."""
    return np.exp(-square_sum(ground_normal(now)[:, :2]) / 0.2)


def _pose(now: Moment) -> Array:
    """Reward term: agreement of the joint angles with the stance, from 0 to 1, (num_envs,).

    The tolerances of the angles (`STANDING`, `WALKING` and `RUNNING` of the task) depend on the speed of the command.
    """
    stand, walk, run = _tolerances(now.sim.model, type(now.task))
    speed = _speed(now)[:, None]
    tolerance = np.where(speed < _MOVES, stand, np.where(speed < _RUNS, walk, run))
    reward: Array = np.exp(-square_sum((now.qpos[:, 7:] - stance(now.sim.model)) / tolerance) / now.sim.model.nu)
    return reward


def _limits(now: Moment) -> Array:
    """Reward term: sum of the angles by which joints exceed their soft limits, (num_envs,), rad."""
    low, high = _soft_limits(now.sim.model)
    angles = now.qpos[:, 7:]
    beyond: Array = np.einsum("ij->i", np.maximum(low - angles, 0.0) + np.maximum(angles - high, 0.0))
    return beyond


def _action_rate(now: Moment) -> Array:
    """Reward term: squared norm of the difference between the last two actions, (num_envs,)."""
    return square_sum(now.episode_state["last"] - now.episode_state["before"])


def _clearance(now: Moment) -> Array:
    """Reward term: sum over the feet of |height - target height| times horizontal speed, (num_envs,), m^2/s.

    It is 0 if the command is to stand.
    """
    return _moving(now, np.abs(foot_heights(now) - _HEIGHT) * foot_speeds(now))


def _swing(now: Moment) -> Array:
    """Reward term: sum of (greatest height of the swing / target height - 1)^2 over the feet that just landed, (num_envs,).

    It is 0 if the command is to stand.
    """
    state = now.episode_state
    return _moving(now, np.square(state["swing"] / _HEIGHT - 1.0) * state["landed"])


def _air_time(now: Moment) -> Array:
    """Reward term: number of feet that have been in the air for 0.05 to 0.5 s, (num_envs,).

    It is 0 if the commanded speed (m/s, plus the rate of turn in rad/s) is 0.5 or less.
    """
    time = now.episode_state["air_time"]
    count: Array = ((time > _AIR_TIMES[0]) & (time < _AIR_TIMES[1])).sum(axis=1) * (_speed(now) > _MOVES_FAST)
    return count


def _slip(now: Moment) -> Array:
    """Reward term: sum of the squared horizontal speeds of feet on the ground, (num_envs,), m^2/s^2; 0 if the command is to stand."""
    return _moving(now, np.square(foot_speeds(now)) * (foot_forces(now) > 0.0))


def _landing(now: Moment) -> Array:
    """Reward term: sum of the normal forces on feet that just landed, (num_envs,), N; 0 if the command is to stand."""
    return _moving(now, foot_forces(now) * now.episode_state["landed"])


def _roll_rate(now: Moment) -> Array:
    """Reward term: squared angular velocity of the base about its x and y axes, (num_envs,), rad^2/s^2."""
    return square_sum(now.qvel[:, 3:5])


def _collisions(part: str) -> Callable[[Moment], Array]:
    """Function that computes the reward term for collisions of a part of the robot with the terrain, (num_envs,).

    The term is `frame_skip` (the number of time steps per action) if a geom of the part collides in the last of these steps, else 0.

    Args:
        part: Attribute of the task with the names of the geoms: "SHANKS" or "TRUNK".
    """

    def collisions(now: Moment) -> Array:
        collides = touches_terrain(now, getattr(now.task, part))
        count: Array = now.task.frame_skip * collides.astype(np.float64)
        return count

    return collisions


def touches_terrain(now: Moment, geoms: tuple[str, ...]) -> Array:
    """Whether at least one of the geoms pressed on the terrain with more than 10 N in the last time step: (num_envs,) bool."""
    if not geoms:
        return np.zeros(len(now.action), dtype=bool)
    return np.asarray(np.any(contact_forces(now, geoms, ["terrain"]) > _COLLISION_FORCE, axis=1))


def _moving(now: Moment, costs: Array) -> Array:
    """Sum over the feet of costs (num_envs, nfeet), 0 in environments whose command is to stand: (num_envs,)."""
    # einsum, because np.sum would add the costs in another order for a single environment, with other rounding.
    sums: Array = np.einsum("ij->i", costs) * (_speed(now) > _MOVES)
    return sums


TERMS: Mapping[str, Callable[[Moment], Array]] = {
    "track_linear_velocity": _linear,
    "track_angular_velocity": _angular,
    "upright": _upright,
    "pose": _pose,
    "body_ang_vel": _roll_rate,
    "dof_pos_limits": _limits,
    "action_rate": _action_rate,
    "foot_clearance": _clearance,
    "air_time": _air_time,
    "foot_swing_height": _swing,
    "foot_slip": _slip,
    "soft_landing": _landing,
    "shank_collision": _collisions("SHANKS"),
    "trunk_collision": _collisions("TRUNK"),
}
"""Unweighted reward terms by name: functions of a moment (view of all environments) that return values (num_envs,)."""


def terms_of(now: Moment, weights: Mapping[str, float]) -> Terms:
    """Reward terms times their weights, (num_envs,) each, by name. Terms of weight 0 are left out."""
    return {name: weight * TERMS[name](now) for name, weight in weights.items() if weight}


@cache_per_model
def _tolerances(model: Model, task: type) -> tuple[Array, Array, Array]:
    """Tolerances of the joint angles for commands to stand, to walk and to run: (nu,) rad each."""
    tables = (task.STANDING, task.WALKING, task.RUNNING)  # type: ignore[attr-defined]
    names = model.joint_names[1:]
    found = [np.array([next(v for pattern, v in table.items() if re.search(pattern, name)) for name in names]) for table in tables]
    return found[0], found[1], found[2]


@cache_per_model
def _soft_limits(model: Model) -> tuple[Array, Array]:
    """Lower and upper soft limits of the joints: (nu,) rad each."""
    low, high = np.asarray(model.jnt_range)[1:].T
    middle, half = 0.5 * (low + high), 0.5 * _SOFT * (high - low)
    return middle - half, middle + half
