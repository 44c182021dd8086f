"""Gymnasium's Humanoid-v5, which walks, and HumanoidStandup-v5, which stands up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_per_model
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum, within
from stepper.envs.tasks.base import NoisyTask
from stepper.shared.view import per_moment


@cache_per_model
def _tendon_matrices(model: Model) -> tuple[Array, Array]:
    """Matrices L (nq, ntendon) and V (nv, ntendon): qpos @ L are the lengths of the fixed tendons, qvel @ V their velocities."""
    names = model.tendon_names
    lengths, rates = np.zeros((model.nq, len(names))), np.zeros((model.nv, len(names)))
    for k in range(len(names)):
        tendon = model.tendon(k)
        for joint, coefficient in zip(tendon.jntid.tolist(), tendon.coef.tolist(), strict=True):
            lengths[model.joint(joint).qposadr, k] = coefficient
            rates[model.joint(joint).dofadr, k] = coefficient
    return lengths, rates


def tendons(now: TaskView) -> Terms:
    """Returns the lengths and velocities of the fixed tendons, (num_envs, ntendon) each.

    The names in the result are "tendon_length" (m or rad) and "tendon_velocity" (m/s or rad/s).
    """
    lengths, rates = _tendon_matrices(now.sim.model)
    return {"tendon_length": now.qpos @ lengths, "tendon_velocity": now.qvel @ rates}


BODY_TABLES = (
    Observation("cinert", columns=slice(10, None)),
    Observation("cvel", columns=slice(6, None)),
    Observation("qfrc_actuator", columns=slice(6, None)),
    Observation("cfrc_ext", columns=slice(6, None)),
)
"""Observations of humanoids: quantities of all bodies except the world, and actuator forces on all joints except the free one."""


class HumanoidTask(NoisyTask):
    """Task of a humanoid. Abstract."""

    exclude_current_positions_from_observation: bool

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (348,) by default: positions, velocities, and those rows of `BODY_TABLES` that the task's arguments include.

        The positions x and y are left out by default.
        """
        return (
            Observation("qpos", columns=slice(2 * int(self.exclude_current_positions_from_observation), None)),
            Observation("qvel"),
            *(table for table in BODY_TABLES if getattr(self, f"include_{table.name}_in_observation")),
        )


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


@dataclass(frozen=True, kw_only=True)
class HumanoidStandup(HumanoidTask):
    """Task: stand up. The arguments are those of Gymnasium's environment. An episode never terminates.

    Observations and rewards use quantities of bodies in the state after the step, and the initial quaternion is normalised after noise is
    added. Both differ from Gymnasium's environment, as in `Humanoid`.
    """

    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 4.0, "lookat": (0.0, 0.0, 0.8925), "elevation": -20.0}

    xml_file: str = "humanoidstandup.xml"
    frame_skip: int = 5
    uph_cost_weight: float = 1.0
    ctrl_cost_weight: float = 0.1
    impact_cost_weight: float = 0.5e-6
    impact_cost_range: tuple[float, float] = (-np.inf, 10.0)
    reset_noise_scale: float = 1e-2
    exclude_current_positions_from_observation: bool = True
    include_cinert_in_observation: bool = True
    include_cvel_in_observation: bool = True
    include_qfrc_actuator_in_observation: bool = True
    include_cfrc_ext_in_observation: bool = True

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: height of the torso divided by the time step, plus 1, minus costs of squared controls and contact forces.

        `uph_cost_weight` has no effect, as in Gymnasium's environment.
        """
        up = now.qpos[:, 2] / now.sim.timestep
        control = self.ctrl_cost_weight * square_sum(now.action)
        impact = np.clip(self.impact_cost_weight * square_sum(now.cfrc_ext), *self.impact_cost_range)
        return up - control - impact + 1.0, {"reward_linup": up, "reward_quadctrl": -control, "reward_impact": -impact}

    def info(self, now: TaskView) -> Terms:
        """Info: position of the torso, m, and lengths and velocities of the tendons."""
        x, y, z = now.qpos[:, :3].T
        return {"x_position": x, "y_position": y, "z_distance_from_origin": z - now.default_qpos[2], **tendons(now)}
