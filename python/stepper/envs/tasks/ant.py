"""Gymnasium's Ant-v5: a torso on four legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum
from stepper.envs.tasks.base import NoisyTask
from stepper.shared.arguments import check_whole
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class Ant(NoisyTask):
    """Task: run in x without falling. The arguments are those of Gymnasium's environment.

    Rewards and observations differ slightly from Gymnasium's. They use the torso's position after the step. Gymnasium uses the torso's
    position in the last stage of MuJoCo's Runge-Kutta step, which differs by O(h^3) for the time step h. The same holds for the point
    about which the observed contact torques act. The initial quaternion is normalised after noise is added; Gymnasium's first observation
    has the quaternion before normalisation.
    """

    camera: ClassVar[Camera] = {"distance": 4.0}
    normal_velocities: ClassVar[bool] = True

    xml_file: str = "ant.xml"
    frame_skip: int = 5
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.5
    contact_cost_weight: float = 5e-4
    healthy_reward: float = 1.0
    main_body: int | str = 1
    terminate_when_unhealthy: bool = True
    healthy_z_range: tuple[float, float] = (0.2, 1.0)
    contact_force_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True
    include_cfrc_ext_in_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (105,) by default: positions without x and y, velocities, clipped contact torques and forces on the bodies.

        The arguments of the task can add x and y, and leave out the contact torques and forces.
        """
        rows = (
            Observation("qpos", columns=slice(2 * int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel"),
        )
        contacts = Observation("cfrc_ext", func=_contact_forces, columns=slice(6, None), unit="N m, N")
        return (*rows, contacts) if self.include_cfrc_ext_in_observation else rows

    def position(self, now: TaskView) -> Array:
        """Position of the main body in x and y, (num_envs, 2), m."""
        model = now.sim.model
        body = model.body(self.main_body).id if isinstance(self.main_body, str) else self.main_body
        check_whole("main_body, if it is no name,", body, least=0, most=model.nbody - 1)
        xy: Array = now.qpos[:, :2] if body == 1 else now.xpos[:, body, :2]
        return xy

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the torso's height is within `healthy_z_range`, (num_envs,) bool."""
        low, high = self.healthy_z_range
        z = now.qpos[:, 2]
        healthy: Array = (low <= z) & (z <= high)
        return healthy

    def terminated(self, now: TaskView) -> Array | None:
        """Whether each environment is unhealthy, (num_envs,) bool. None (no episode terminates) with `terminate_when_unhealthy=False`."""
        return ~self.healthy(now) if self.terminate_when_unhealthy else None

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x plus a bonus for being healthy, minus costs of squared controls and contact forces."""
        x_velocity, y_velocity = now.velocity.T
        forward, survive = self.forward_reward_weight * x_velocity, self.healthy_reward * self.healthy(now)
        control = self.ctrl_cost_weight * square_sum(now.action)
        contact = self.contact_cost_weight * square_sum(_contact_forces(now))
        terms = {"x_velocity": x_velocity, "y_velocity": y_velocity, "reward_forward": forward, "reward_ctrl": -control}
        terms |= {"reward_contact": -contact, "reward_survive": survive}
        return forward + survive - (control + contact), terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the torso, m."""
        x, y = now.qpos[:, :2].T
        return {"x_position": x, "y_position": y, "distance_from_origin": np.hypot(x, y)}


@per_moment
def _contact_forces(now: TaskView) -> Array:
    """Clipped contact torques (N m) and forces (N) on the bodies, (num_envs, nbody, 6)."""
    forces: Array = np.clip(now.cfrc_ext, *now.task.contact_force_range)
    return forces
