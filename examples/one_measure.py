"""One measurement function, used for a reward, for an observation, for an outcome of a study, and with a stepper.

A two-link arm reaches for a target. The objects that tasks and studies pass to their functions have the same read interface as
`stepper.Stepper`: `qpos`, `xpos`, `sensordata`, `contacts()` and `read(name, of)`. So the function `distance` works with all of them.

    python examples/one_measure.py      # prints the same distance four times
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.envs import Observation, StepperVectorEnv, Task

Array = NDArray[Any]

SCENE = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 0 1" damping="0.1"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
      <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 0 1" damping="0.1"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/><site name="hand" pos=".3 0 0"/></body></body>
    <site name="target" pos=".2 .4 0"/>
  </worldbody>
  <actuator><motor joint="shoulder" ctrlrange="-1 1"/><motor joint="elbow" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
CTRL = np.array([0.05, 0.02])
"""Joint torques in all four runs, N m."""
STEPS = 20
"""Number of simulation steps in all four runs."""


def distance(now: Any) -> Array:
    """Distance from the hand to the target, (num_envs,) m."""
    return np.asarray(np.linalg.norm(now.read("site_xpos", "hand") - now.read("site_xpos", "target"), axis=-1))


@dataclass(frozen=True, kw_only=True)
class Reach(Task):
    """Reaching task. The reward is the negative distance, and the distance is also an observation."""

    frame_skip: int = STEPS

    def model(self) -> stepper.Model:
        """Model of the arm."""
        return stepper.load(SCENE)

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, velocities and the distance."""
        return (Observation("qpos"), Observation("qvel"), Observation("distance", func=distance))

    def reward(self, now: Any) -> tuple[Array, dict[str, Array]]:
        """Negative distance to the target, (num_envs,)."""
        return -distance(now), {}


def measured() -> dict[str, float]:
    """Distances after the same motion, from a stepper, a reward, an observation and an outcome of a study."""
    sim = stepper.Stepper(stepper.load(SCENE), num_envs=2)
    sim.step(CTRL, nstep=STEPS)

    env = StepperVectorEnv(Reach(), num_envs=2)
    env.reset(seed=0)
    observation, reward, *_ = env.step(np.tile(CTRL, (2, 1)))

    outcome = stepper.lab.Outcome(name="distance", measure=distance, unit="m")
    study = stepper.lab.Study(model=SCENE, controller=lambda now: CTRL, outcomes=outcome, seconds=0.01 * STEPS, control=0.01 * STEPS)
    return {
        "stepper": float(distance(sim)[0]),
        "reward": -float(reward[0]),
        "observation": float(observation[0, -1]),
        "outcome": study.episode()["outcomes"]["distance"],
    }


if __name__ == "__main__":
    for place, value in measured().items():
        print(f"{place:12} {value:.15f} m")
