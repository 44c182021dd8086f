"""Gymnasium's HumanoidStandup-v5: a lying humanoid that must stand up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array, Camera, TaskView, Terms, square_sum
from stepper.envs.tasks.humanoid_rows import HumanoidTask, tendons


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
