"""Task of a gripper that lifts a box with small forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._options import Options
from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.events import Event, at_reset
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Camera, Reset, Task, TaskView, Terms, square_sum
from stepper.shared.draws import scale, uniform

GRAVITY, MASS, FRICTION = 9.81, 0.8, 0.6
FORCE, STEPS = 20.0, 50
"""Largest force of a finger, N; number of actions per episode."""
SCENE = f"""
<mujoco model="grasp">
  <option timestep="0.004" gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" friction="{FRICTION}"/>
    <body name="hand" pos="0 0 .05">
      <joint name="lift" type="slide" axis="0 0 1" damping="10"/>
      <inertial pos="0 0 .1" mass="1" diaginertia=".01 .01 .01"/>
      <body name="left" pos="-.05 0 0"><joint name="left" type="slide" axis="1 0 0" damping="10"/>
        <geom name="left" type="sphere" size=".01" mass=".1" friction="{FRICTION}"/></body>
      <body name="right" pos=".05 0 0"><joint name="right" type="slide" axis="-1 0 0" damping="10"/>
        <geom name="right" type="sphere" size=".01" mass=".1" friction="{FRICTION}"/></body>
    </body>
    <body name="box" pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="box" type="box" size=".03 .03 .05" mass="{MASS}" friction="{FRICTION}"/>
    </body>
  </worldbody>
  <actuator>
    <general joint="lift" gainprm="30" biastype="affine" biasprm="{1.2 * GRAVITY} 0 0" ctrlrange="-1 1"/>
    <motor joint="left" gear="{FORCE}" ctrlrange="-1 1"/>
    <motor joint="right" gear="{FORCE}" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
"""MJCF of two fingers and a hand in a plane, moved by forces, and a box between the fingers."""
OPTIONS = Options(integrator="euler", stabilization="baumgarte", baumgarte=1.0, slop=0.0)
"""Hard contact that is differentiable for a box at rest (docs/how-to/derivatives.md)."""


@dataclass(frozen=True, kw_only=True)
class Grasp(Task):
    """Task: lift the box with small forces of the fingers.

    Friction holds the box if each finger presses with at least m g / (2 mu): 6.5 N with the default numbers.

    Attributes:
        frame_skip: Time steps (4 ms each) per action.
        rise: Target height of the box above its initial height, m.
        weight: Weight in the reward of the squared finger controls, which are forces divided by the largest force of 20 N.
        friction: Lowest and highest friction coefficient of all geoms. If they differ, each episode draws one.
        mass_scale: Lowest and highest factor of the mass of the box. If they differ, each episode draws one.
    """

    camera: ClassVar[Camera] = {"distance": 0.6, "azimuth": 90.0, "elevation": -10.0, "lookat": (0.0, 0.0, 0.1)}
    frame_skip: int = 5
    rise: float = 0.1
    weight: float = 0.25
    friction: tuple[float, float] = (FRICTION, FRICTION)
    mass_scale: tuple[float, float] = (1.0, 1.0)

    def model(self) -> Model:
        """Model of the gripper and the box."""
        return _scene()

    def observations(self) -> tuple[Observation, ...]:
        """Joint positions and velocities: (10,)."""
        return Observation("qpos"), Observation("qvel")

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: 1 - ((height - rise) / rise)^2 - weight * sum of the squared finger controls. `rise` is the target height, m.

        The info "rise" is the height of the box above its initial height, m.
        """
        miss = (now.qpos[:, 4] - self.rise) / self.rise
        reward: Array = 1.0 - np.square(miss) - self.weight * square_sum(now.action[:, 1:])
        return reward, {"rise": now.qpos[:, 4]}

    def reset(self, reset: Reset) -> None:
        """Initial states: the box within 5 mm of the middle, each finger up to 5 mm farther from the middle than in the model."""
        reset.qpos[:, 3] += reset.rng.uniform(-0.005, 0.005, 1)[:, 0]
        reset.qpos[:, 1:3] -= reset.rng.uniform(0.0, 0.005, 2)

    def events(self) -> tuple[Event, ...]:
        """Friction of all geoms and mass of the box, each only if the two bounds of its range differ."""
        friction = at_reset("geom_friction[*][0]", uniform(*self.friction, shared=True))
        mass = at_reset("body_mass[box]", scale(*self.mass_scale))
        return (friction,) * (self.friction[0] != self.friction[1]) + (mass,) * (self.mass_scale[0] != self.mass_scale[1])


@cache_model
def _scene() -> Model:
    return load_quietly(SCENE)
