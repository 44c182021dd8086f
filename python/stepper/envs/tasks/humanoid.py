"""Gymnasium's Humanoid-v5: a humanoid that walks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum, within
from stepper.envs.tasks.humanoid_rows import HumanoidTask, tendons
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Humanoid(HumanoidTask):
    """Task: walk in x without falling. The arguments are those of Gymnasium's environment.

    Observations and rewards use centres of mass, inertias and velocities of bodies in the state after the step. Gymnasium uses those in
    the last stage of MuJoCo's Runge-Kutta step, which differ by O(h^3) for the time step h. The initial quaternion is normalised after
    noise is added; Gymnasium's first observation has the quaternion before normalisation.
    """

    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 4.0, "lookat": (0.0, 0.0, 2.0), "elevation": -20.0}

    xml_file: str = "humanoid.xml"
    frame_skip: int = 5
    forward_reward_weight: float = 1.25
    ctrl_cost_weight: float = 0.1
    contact_cost_weight: float = 5e-7
    contact_cost_range: tuple[float, float] = (-np.inf, 10.0)
    healthy_reward: float = 5.0
    terminate_when_unhealthy: bool = True
    healthy_z_range: tuple[float, float] = (1.0, 2.0)
    reset_noise_scale: float = 1e-2
    exclude_current_positions_from_observation: bool = True
    include_cinert_in_observation: bool = True
    include_cvel_in_observation: bool = True
    include_qfrc_actuator_in_observation: bool = True
    include_cfrc_ext_in_observation: bool = True

    def position(self, now: TaskView) -> Array:
        """Position of the centre of mass in x and y, (num_envs, 2), m."""
        xy: Array = now.subtree_com[:, 0, :2]
        return xy

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the torso's height is within `healthy_z_range`, (num_envs,) bool."""
        return within(now.qpos[:, 2], self.healthy_z_range)

    def terminated(self, now: TaskView) -> Array | None:
        """Whether each environment is unhealthy, (num_envs,) bool. None (no episode terminates) with `terminate_when_unhealthy=False`."""
        return ~self.healthy(now) if self.terminate_when_unhealthy else None

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x plus a bonus for being healthy, minus costs of squared controls and contact forces."""
        x_velocity, y_velocity = now.velocity.T
        forward, survive = self.forward_reward_weight * x_velocity, self.healthy_reward * self.healthy(now)
        control = self.ctrl_cost_weight * square_sum(now.action)
        contact = np.clip(self.contact_cost_weight * square_sum(now.cfrc_ext), *self.contact_cost_range)
        terms = {"x_velocity": x_velocity, "y_velocity": y_velocity, "reward_survive": survive, "reward_forward": forward}
        terms |= {"reward_ctrl": -control, "reward_contact": -contact}
        return forward + survive - (control + contact), terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the torso, m, and lengths and velocities of the tendons."""
        x, y = now.qpos[:, :2].T
        return {"x_position": x, "y_position": y, **tendons(now), "distance_from_origin": np.hypot(x, y)}
