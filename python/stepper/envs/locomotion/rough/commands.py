"""Velocity commands that change during an episode, and random pushes of the base, for tasks on rough terrain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepper._stepper import Stepper
from stepper.envs.locomotion.rough.state import heading
from stepper.envs.task import Array, Moment, Terms, per_moment
from stepper.envs.terrain import stage_of
from stepper.shared.rotations import matrices
from stepper.shared.streams import Rng

Stages = Sequence[tuple[int, tuple[float, ...]]]

STAGES: Stages = ((0, (-1.0, 1.0, 1.0, 0.5)), (120_000, (-1.5, 2.0, 1.0, 0.7)), (240_000, (-2.0, 3.0, 1.0, 0.7)))
"""Stages of the curriculum of commands: the number of actions of an environment at which a stage begins, and bounds of its commands.

The bounds are the lowest and highest velocity along x, the highest along y (m/s), and the highest about z (rad/s).
"""
_TIMES = (3.0, 8.0)
"""Shortest and longest duration of a command, s."""
_STANDING, _HEADING, _FORWARD = 0.1, 0.3, 0.2
"""Probabilities that a command is to stand, to turn to a heading, and to go straight ahead."""
_SLOWEST = 0.3
"""Least velocity of a command to go straight ahead, m/s."""
_STIFFNESS = 0.5
"""Commanded rate of turn divided by the angle from the current to the commanded heading, 1/s."""
_PUSH_TIMES = (1.0, 3.0)
"""Least and longest time between two pushes, s."""
_PUSHES = np.array([0.5, 0.5, 0.4, 0.52, 0.52, 0.78])
"""Largest changes of the base's velocity (m/s) and of its rates of turn (rad/s) by a push, along the world's axes."""


def command_state(num_envs: int) -> Terms:
    """Initial arrays for commands and pushes, (num_envs, ...) by name, as parts of `Task.episode_state`."""
    whole = {name: np.zeros(num_envs, dtype=np.int64) for name in ("steps", "command_left", "push_left")}
    flags = {name: np.zeros(num_envs, dtype=bool) for name in ("turns_to_heading", "stands")}
    return whole | flags | {"velocity_command": np.zeros((num_envs, 3)), "heading_command": np.zeros(num_envs)}


def draw_commands(state: Terms, envs: Array, rng: Rng, dt: float, stages: Stages = STAGES) -> None:
    """Draws commands of the environments `envs` (n,), and the number of actions for which they hold.

    Args:
        state: Arrays of the task's episode state, which are changed in place.
        envs: Indices of the environments, (n,).
        rng: Random number generator of these environments.
        dt: Duration of one action, s.
        stages: Bounds of the commands, which depend on the number of actions that an environment has made so far.
    """
    low_x, high_x, high_y, high_turn = stage_of(state["steps"][envs], stages).T
    drawn = rng.uniform(0.0, 1.0, 8)
    command = np.stack([low_x + drawn[:, 0] * (high_x - low_x), (2.0 * drawn[:, 1] - 1.0) * high_y, (2.0 * drawn[:, 2] - 1.0) * high_turn])
    ahead = drawn[:, 3] < _FORWARD
    command[0] = np.where(ahead, np.maximum(np.abs(command[0]), _SLOWEST), command[0])
    command[1:, ahead] = 0.0
    state["velocity_command"][envs] = command.T
    state["stands"][envs] = drawn[:, 4] < _STANDING
    state["turns_to_heading"][envs] = drawn[:, 5] < _HEADING
    state["heading_command"][envs] = np.pi * (2.0 * drawn[:, 6] - 1.0)
    state["command_left"][envs] = _actions(drawn[:, 7], _TIMES, dt)


def resample_commands(now: Moment, stages: Stages = STAGES) -> None:
    """Draws new commands in the environments whose current command has expired."""
    state = now.episode_state
    state["command_left"] -= 1
    due = np.flatnonzero(state["command_left"] <= 0)
    if len(due):
        draw_commands(state, due, _rng_of(now.rng("command"), due), now.dt, stages)


def draw_push_times(state: Terms, envs: Array, rng: Rng, dt: float) -> None:
    """Draws the number of actions before the next push, for the environments `envs`, indices (n,).

    Args:
        state: Arrays of the task's episode state, which are changed in place.
        envs: Indices of the environments, (n,).
        rng: Random number generator of these environments.
        dt: Duration of one action, s.
    """
    state["push_left"][envs] = _actions(rng.uniform(0.0, 1.0, 1)[:, 0], _PUSH_TIMES, dt)


def push(now: Moment, scale: float) -> None:
    """Pushes the base in environments whose time for a push has come: changes its velocities by random amounts.

    Args:
        now: View of all environments.
        scale: Factor of the largest changes of velocity.
    """
    state, sim = now.episode_state, now.sim
    state["push_left"] -= 1
    due = np.flatnonzero(state["push_left"] <= 0)
    if len(due):
        rng = _rng_of(now.rng("push"), due)
        changes = scale * _PUSHES * rng.uniform(-1.0, 1.0, 6)
        draw_push_times(state, due, rng, now.dt)
        if scale:
            _change_velocities(sim, due, changes)


def _change_velocities(sim: Stepper, envs: Array, changes: Array) -> None:
    """Adds changes, (n, 6) in world axes, m/s and rad/s, to the velocities of the base in the environments `envs`, indices (n,)."""
    qvel = np.array(sim.qvel[envs], dtype=np.float64)
    qvel[:, :3] += changes[:, :3]
    # Rates of turn of a free joint are in the frame of the body.
    qvel[:, 3:6] += np.einsum("ni,nij->nj", changes[:, 3:], matrices(np.asarray(sim.qpos[envs, 3:7], dtype=np.float64)))
    sim.set_state(qvel=qvel, envs=envs, keep_warmstart=True)


@per_moment
def command(now: Moment) -> Array:
    """Current command: velocities along x and y (m/s) and about z (rad/s) in the frame of the base, (num_envs, 3)."""
    state = now.episode_state
    wanted: Array = np.array(state["velocity_command"])
    limit = stage_of(state["steps"], now.task.stages)[:, 3]
    difference = np.remainder(state["heading_command"] - heading(now) + np.pi, 2.0 * np.pi) - np.pi
    turn = np.clip(_STIFFNESS * difference, -limit, limit)
    wanted[:, 2] = np.where(state["turns_to_heading"], turn, wanted[:, 2])
    wanted[state["stands"]] = 0.0
    return wanted


def _actions(drawn: Array, times: tuple[float, float], dt: float) -> Array:
    """Converts random numbers to random durations, each in actions and at least 1: int, in the shape of `drawn`.

    Args:
        drawn: Uniform random numbers from 0 (shortest duration) to 1 (longest duration).
        times: Shortest and longest duration, s.
        dt: Duration of one action, s.
    """
    seconds = times[0] + drawn * (times[1] - times[0])
    count: Array = np.maximum(1, np.round(seconds / dt)).astype(np.int64)
    return count


def _rng_of(rng: Rng, envs: Array) -> Rng:
    """Random number generator for some environments of `rng`, given by their indices (n,)."""
    mask = np.zeros(len(rng.envs), dtype=bool)
    mask[envs] = True
    return rng.of(mask)
