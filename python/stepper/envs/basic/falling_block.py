"""Task of a falling block with a thruster, which must stay above the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._options import Options
from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, Reset, Task, TaskView, Terms
from stepper.sensors import SensorModel, Transfer

SCENE = """
<mujoco model="falling block">
  <option timestep="0.02"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="block" pos="0 0 0.1">
      <joint name="height" type="slide" axis="0 0 1"/>
      <geom name="block" type="box" size="0.1 0.1 0.1" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="thruster" joint="height" gear="4.905" ctrllimited="true" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos name="height" joint="height"/><jointvel name="velocity" joint="height"/></sensor>
</mujoco>
"""
"""MJCF of a block of 1 kg over a floor, which it touches at height 0. The largest force of the thruster is half the block's weight."""
HEIGHT, VELOCITY = 0.20, -0.10
"""Initial height, m, and velocity, m/s."""
LOWEST, STEPS = 0.05, 50
"""Height above which the reward of an action is 1, m; number of actions per episode."""
OPTIONS = Options(integrator="euler", restitution_threshold=0.0)
"""Options that give the textbook recursion v <- v - g dt, h <- h + v dt, and below the floor h <- 0, v <- -e v at any speed."""


@dataclass(frozen=True, kw_only=True)
class FallingBlock(Task):
    """Task: keep the block above 0.05 m with a thruster of at most half the weight, up or down. Each episode draws a restitution.

    Attributes:
        frame_skip: Time steps (20 ms each) per action.
        restitution: Lowest and highest restitution.
        noise: Standard deviation of the noise of the sensors of height (m) and velocity (m/s); rewards use the true height.
    """

    camera: ClassVar[Camera] = {"distance": 1.5, "elevation": -15.0, "lookat": (0.0, 0.0, 0.2)}
    frame_skip: int = 1
    restitution: tuple[float, float] = (0.1, 0.5)
    noise: float = 0.0

    def model(self) -> Model:
        """Model of the block over the floor."""
        return _scene()

    def sensors(self) -> SensorModel | None:
        """Sensor model with normal noise on height (m) and velocity (m/s); None if `noise` is 0."""
        return SensorModel(default=Transfer(noise_std=self.noise)) if self.noise else None

    def observations(self) -> tuple[Observation, ...]:
        """Sensor readings of height (m) and velocity (m/s): (2,)."""
        return (Observation("sensordata"),)

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: 1 if the block is above 0.05 m (`LOWEST`), else 0."""
        height = now.qpos[:, 0]
        return (height > LOWEST).astype(np.float64), {"height": height}

    def info(self, now: TaskView) -> Terms:
        """Info: the restitution of each episode."""
        return {"restitution": now.episode_state["restitution"]}

    def episode_state(self, num_envs: int) -> Terms:
        """Array for the restitution of each episode, which `reset` draws."""
        return {"restitution": np.zeros(num_envs)}

    def reset(self, reset: Reset) -> None:
        """Sets the initial height and velocity of the block, equal in all environments."""
        reset.qpos[:], reset.qvel[:] = HEIGHT, VELOCITY
        restitution = reset.rng.uniform(*self.restitution, 1)[:, 0]
        reset.episode_state["restitution"] = restitution
        reset.sim.randomize(geom_restitution=np.stack([np.zeros_like(restitution), restitution], axis=1), envs=reset.envs)


@cache_model
def _scene() -> Model:
    return load_quietly(SCENE)
