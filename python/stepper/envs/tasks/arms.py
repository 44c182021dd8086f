"""Gymnasium's Reacher-v5 and Pusher-v5: arms that move a fingertip or a cylinder to a goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, MujocoTask, Reset, TaskView, Terms, square_sum
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Reacher(MujocoTask):
    """Task: bring the fingertip to the target. The arguments are those of Gymnasium's environment. An episode never terminates.

    Observations and rewards use the position of the fingertip in the state after the step. Gymnasium uses the position in the last stage
    of MuJoCo's Runge-Kutta step, which differs by O(h^3) for the time step h.
    """

    camera: ClassVar[Camera] = {"distance": 1.24}
    xml_file: str = "reacher.xml"
    frame_skip: int = 2
    reward_dist_weight: float = 1.0
    reward_control_weight: float = 1.0

    def observations(self) -> tuple[Observation, ...]:
        """Cosines and sines of the angles, position of the target, angular velocities, and fingertip minus target in x and y: (10,)."""
        return (
            Observation("cos", func=lambda now: np.cos(now.qpos[:, :2])),
            Observation("sin", func=lambda now: np.sin(now.qpos[:, :2])),
            Observation("qpos", columns=slice(2, None)),
            Observation("qvel", columns=slice(0, 2)),
            Observation("fingertip", func=_to_target, columns=slice(0, 2), unit="m"),
        )

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: minus the distance from the fingertip to the target, minus a cost of squared controls."""
        distance = -self.reward_dist_weight * np.sqrt(square_sum(_to_target(now)))
        control = -self.reward_control_weight * square_sum(now.action)
        return distance + control, {"reward_dist": distance, "reward_ctrl": control}

    def reset(self, reset: Reset) -> None:
        """Initial states: the arm in the reference pose with uniform noise on angles and velocities, the target at rest at a random place.

        The place is uniformly distributed in the disc of radius 0.2 m about the origin.
        """
        reset.qpos += reset.rng.uniform(-0.1, 0.1, reset.qpos.shape[1])
        radius, angle = 0.2 * np.sqrt(reset.rng.uniform(0.0, 1.0, 1)[:, 0]), reset.rng.uniform(-np.pi, np.pi, 1)[:, 0]
        reset.qpos[:, -2:] = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        reset.qvel += reset.rng.uniform(-0.005, 0.005, reset.qvel.shape[1])
        reset.qvel[:, -2:] = 0.0


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the target to the fingertip, (num_envs, 3), m."""
    fingertip, target = _bodies(now.model, "fingertip", "target")
    difference: Array = now.xpos[:, fingertip] - now.xpos[:, target]
    return difference


@cache_per_model
def _bodies(model: Model, *names: str) -> Array:
    """Indices of bodies by name."""
    return np.array([model.body(name).id for name in names])


_OBSERVED = ("tips_arm", "object", "goal")  # Names of the bodies of fingertips, cylinder and goal.
NEAREST = 0.17
"""Smallest initial distance of the cylinder from the goal, m."""


@dataclass(frozen=True, kw_only=True)
class Pusher(MujocoTask):
    """Task: push the cylinder to the goal. The arguments are those of Gymnasium's environment. An episode never terminates.

    The observation and the reward use the positions of bodies before the last of the `frame_skip` steps. Gymnasium's task has this delay,
    because `mj_step` computes positions at the start of a step. After a reset, observation and reward use the
    positions in the current state.
    """

    camera: ClassVar[Camera] = {"distance": 4.0}

    xml_file: str = "pusher_v5.xml"
    frame_skip: int = 5
    reward_near_weight: float = 0.5
    reward_dist_weight: float = 1.0
    reward_control_weight: float = 0.1

    def observations(self) -> tuple[Observation, ...]:
        """Angles of the arm, their velocities, and positions of fingertips, cylinder and goal: (23,)."""
        return (
            Observation("qpos", columns=slice(0, 7)),
            Observation("qvel", columns=slice(0, 7)),
            Observation("tips_arm", func=lambda now: _positions(now)[:, 0], unit="m"),
            Observation("object", func=lambda now: _positions(now)[:, 1], unit="m"),
            Observation("goal", func=lambda now: _positions(now)[:, 2], unit="m"),
        )

    def episode_state(self, num_envs: int) -> Terms:
        """Positions of fingertips, cylinder and goal before the last time step, m, and qpos after it; NaN before the first action."""
        return {"positions": np.zeros((num_envs, 3, 3)), "qpos": np.full((num_envs, self.model().nq), np.nan)}

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action, and stores the positions of bodies before the last time step."""
        now.step(nstep=self.frame_skip - 1)
        now.episode_state["positions"][:] = now.sim.xpos.take(_bodies(now.model, *_OBSERVED), axis=1)
        now.step(nstep=1)
        now.episode_state["qpos"][:] = now.sim.qpos

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: minus weighted distances of the cylinder from the fingertips and from the goal, minus a cost of squared controls."""
        tips, cylinder, goal = _positions(now).swapaxes(0, 1)
        near = -self.reward_near_weight * np.sqrt(square_sum(cylinder - tips))
        distance = -self.reward_dist_weight * np.sqrt(square_sum(cylinder - goal))
        control = -self.reward_control_weight * square_sum(now.action)
        return distance + control + near, {"reward_dist": distance, "reward_ctrl": control, "reward_near": near}

    def reset(self, reset: Reset) -> None:
        """Initial states: the reference pose with the cylinder at a random place, and random velocities of the arm.

        The place is uniformly distributed in a rectangle of 0.3 m by 0.4 m, more than 0.17 m (`NEAREST`) from the goal.
        """
        again = np.ones(len(reset.qpos), dtype=bool)
        while again.any():
            some = reset.rng.of(again)
            reset.qpos[again, -4:-2] = np.hstack([some.uniform(-0.3, 0.0, 1), some.uniform(-0.2, 0.2, 1)])
            again = square_sum(reset.qpos[:, -4:-2]) <= NEAREST**2
        reset.qpos[:, -2:] = 0.0
        reset.qvel += reset.rng.uniform(-0.005, 0.005, reset.qvel.shape[1])
        reset.qvel[:, -4:] = 0.0


@per_moment
def _positions(now: TaskView) -> Array:
    """Positions of `_OBSERVED` before the last time step, (num_envs, 3, 3), m; their present positions after a reset or `set_state`."""
    positions: Array = now.episode_state["positions"].copy()  # The next action overwrites the array.
    has_changed = now.episode_state["qpos"] != now.qpos
    if np.count_nonzero(has_changed):
        positions = np.where(has_changed.any(axis=1)[:, None, None], now.xpos.take(_bodies(now.model, *_OBSERVED), axis=1), positions)
    return positions
