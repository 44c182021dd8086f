"""Gymnasium's HalfCheetah-v5, Swimmer-v5, Walker2d-v5, Hopper-v5 and Ant-v5: robots that move in x."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, all_within, square_sum, within
from stepper.envs.tasks.base import NoisyTask
from stepper.shared.arguments import check_whole
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class _Runner(NoisyTask):
    """Task: move a robot in x. Abstract."""

    horizontal: ClassVar[int] = 1
    """Number of horizontal positions, x or x and y. They are the robot's position, and observations leave them out by default."""
    forward_reward_weight: float = 1.0
    exclude_current_positions_from_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Positions and velocities. The horizontal positions are left out by default."""
        left_out = self.horizontal * int(self.exclude_current_positions_from_observation)
        return Observation("qpos", columns=slice(left_out, None)), Observation("qvel")

    def position(self, now: TaskView) -> Array:
        """Position of the robot in x, (num_envs,), or in x and y, (num_envs, 2), m."""
        position: Array = now.qpos[:, 0] if self.horizontal == 1 else now.qpos[:, :2]
        return position


@dataclass(frozen=True, kw_only=True)
class HalfCheetah(_Runner):
    """Task: run to the right with small controls. The arguments are those of Gymnasium's environment. An episode never terminates.

    Observation, (17,) by default: positions without x, and velocities.
    """

    camera: ClassVar[Camera] = {"distance": 4.0}
    normal_velocities: ClassVar[bool] = True

    xml_file: str = "half_cheetah.xml"
    frame_skip: int = 5
    ctrl_cost_weight: float = 0.1
    reset_noise_scale: float = 0.1

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x minus a cost of squared controls."""
        forward = self.forward_reward_weight * now.velocity
        control = self.ctrl_cost_weight * square_sum(now.action)
        return forward - control, {"x_velocity": now.velocity, "reward_forward": forward, "reward_ctrl": -control}

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m."""
        return {"x_position": now.qpos[:, 0]}


@dataclass(frozen=True, kw_only=True)
class Swimmer(_Runner):
    """Task: swim in x with small controls. The arguments are those of Gymnasium's environment. An episode never terminates.

    Observation, (8,) by default: positions without x and y, and velocities.
    """

    camera: ClassVar[Camera] = {"distance": 8.0}
    horizontal: ClassVar[int] = 2
    xml_file: str = "swimmer.xml"
    frame_skip: int = 4
    ctrl_cost_weight: float = 1e-4
    reset_noise_scale: float = 0.1

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x minus a cost of squared controls."""
        x_velocity, y_velocity = now.velocity.T
        forward = self.forward_reward_weight * x_velocity
        control = self.ctrl_cost_weight * square_sum(now.action)
        terms = {"x_velocity": x_velocity, "y_velocity": y_velocity, "reward_forward": forward, "reward_ctrl": -control}
        return forward - control, terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m."""
        x, y = now.qpos[:, :2].T
        return {"x_position": x, "y_position": y, "distance_from_origin": np.hypot(x, y)}


@dataclass(frozen=True, kw_only=True)
class Walker2d(_Runner):
    """Task: walk to the right without falling. The arguments are those of Gymnasium's environment."""

    camera: ClassVar[Camera] = {"trackbodyid": 2, "distance": 4.0, "lookat": (0.0, 0.0, 1.15), "elevation": -20.0}

    xml_file: str = "walker2d_v5.xml"
    frame_skip: int = 4
    ctrl_cost_weight: float = 1e-3
    healthy_reward: float = 1.0
    terminate_when_unhealthy: bool = True
    healthy_z_range: tuple[float, float] = (0.8, 2.0)
    healthy_angle_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 5e-3

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (17,) by default: positions, and velocities clipped to 10 m/s and rad/s. The position x is left out by default."""
        return super().observations()[0], Observation("qvel", clip=(-10.0, 10.0))

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the height is within `healthy_z_range` and the angle within `healthy_angle_range`, (num_envs,) bool."""
        healthy: Array = within((qpos := now.qpos)[:, 1], self.healthy_z_range) & within(qpos[:, 2], self.healthy_angle_range)
        return healthy

    def terminated(self, now: TaskView) -> Array | None:
        """Whether each environment is unhealthy, (num_envs,) bool. None (no episode terminates) with `terminate_when_unhealthy=False`."""
        return ~self.healthy(now) if self.terminate_when_unhealthy else None

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: velocity in x plus a bonus for being healthy, minus a cost of squared controls."""
        forward, survive = self.forward_reward_weight * now.velocity, self.healthy_reward * self.healthy(now)
        control = self.ctrl_cost_weight * square_sum(now.action)
        terms = {"x_velocity": now.velocity, "reward_forward": forward, "reward_ctrl": -control, "reward_survive": survive}
        return forward + survive - control, terms

    def info(self, now: TaskView) -> Terms:
        """Info: position of the robot, m. The height is measured from the reference pose."""
        return {"x_position": (qpos := now.qpos)[:, 0], "z_distance_from_origin": qpos[:, 1] - now.default_qpos[1]}


@dataclass(frozen=True, kw_only=True)
class Hopper(Walker2d):
    """Task: hop to the right without falling. The arguments are those of Gymnasium's environment.

    Observation, (11,) by default, and reward are those of `Walker2d`.
    """

    camera: ClassVar[Camera] = {"trackbodyid": 2, "distance": 3.0, "lookat": (0.0, 0.0, 1.15), "elevation": -20.0}

    xml_file: str = "hopper.xml"
    frame_skip: int = 4
    healthy_state_range: tuple[float, float] = (-100.0, 100.0)
    healthy_z_range: tuple[float, float] = (0.7, float("inf"))
    healthy_angle_range: tuple[float, float] = (-0.2, 0.2)

    @per_moment
    def healthy(self, now: TaskView) -> Array:
        """Whether the robot is healthy, (num_envs,) bool.

        The height must be in `healthy_z_range`, and the torso's angle in `healthy_angle_range`. The torso's angle, all joint angles and all
        velocities must be in `healthy_state_range`.
        """
        upright = within((qpos := now.qpos)[:, 1], self.healthy_z_range) & within(qpos[:, 2], self.healthy_angle_range)
        moderate = all_within(qpos[:, 2:], self.healthy_state_range) & all_within(now.qvel, self.healthy_state_range)
        healthy: Array = upright & moderate
        return healthy


@dataclass(frozen=True, kw_only=True)
class Ant(_Runner):
    """Task: run in x without falling. The arguments are those of Gymnasium's environment.

    Rewards and observations differ slightly from Gymnasium's. They use the torso's position after the step. Gymnasium uses the torso's
    position in the last stage of MuJoCo's Runge-Kutta step, which differs by O(h^3) for the time step h. The same holds for the point
    about which the observed contact torques act. The initial quaternion is normalised after noise is added; Gymnasium's first observation
    has the quaternion before normalisation.
    """

    camera: ClassVar[Camera] = {"distance": 4.0}
    normal_velocities: ClassVar[bool] = True

    horizontal: ClassVar[int] = 2
    xml_file: str = "ant.xml"
    frame_skip: int = 5
    ctrl_cost_weight: float = 0.5
    contact_cost_weight: float = 5e-4
    healthy_reward: float = 1.0
    main_body: int | str = 1
    terminate_when_unhealthy: bool = True
    healthy_z_range: tuple[float, float] = (0.2, 1.0)
    contact_force_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 0.1
    include_cfrc_ext_in_observation: bool = True

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (105,) by default: positions without x and y, velocities, clipped contact torques and forces on the bodies.

        The arguments of the task can add x and y, and leave out the contact torques and forces.
        """
        rows = super().observations()
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
