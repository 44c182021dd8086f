"""Falling block with a horizontal velocity. In a textbook exercise each impact takes 10 % of this velocity; Coulomb friction does not.

The exercise applies v_z <- -e v_z and v_x <- 0.9 v_x at each impact. The first rule is restitution. The second one is not Coulomb friction:
an impact with Coulomb friction reduces v_x by the speed mu (1 + e) |v_z|, not by a fraction of v_x. One value of mu gives 10 % of 1 m/s
at the first impact. With this mu, slower blocks lose more than 10 %, and later, softer impacts take less speed.

    stepper sweep examples/studies/block.py
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import stepper

G, HEIGHT, DOWN, SPEED, RESTITUTION, LOSS = 9.81, 0.20, 0.10, 1.0, 0.5, 0.1
IMPACT = math.sqrt(DOWN**2 + 2 * G * HEIGHT)
"""Vertical speed at the first impact, m/s."""
THEORY = LOSS * SPEED / ((1 + RESTITUTION) * IMPACT)
"""Friction coefficient at which the first impact takes 10 % of 1 m/s."""

MODEL = f"""
<mujoco model="block">
  <option timestep="0.002" gravity="0 0 -{G}"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1"/>
    <body name="block" pos="0 0 0.05"><joint name="x" type="slide" axis="1 0 0"/><joint name="h" type="slide" axis="0 0 1"/>
      <geom name="block" type="box" size="0.05 0.05 0.05" mass="0.5"/></body>
  </worldbody>
</mujoco>
"""


def model() -> stepper.Model:
    """Model of the scene. Restitution is set here, as MJCF has no attribute for it."""
    return stepper.load(MODEL).replace(geom_restitution=[0.0, RESTITUTION])


def thrown(now: Any, _: list[np.random.Generator]) -> tuple[Any, Any]:
    """Initial qpos and qvel: at `HEIGHT`, moving downwards and sideways."""
    n = now.num_envs
    return np.tile([0.0, HEIGHT], (n, 1)), np.stack([now.parameters["speed"].astype(float), np.full(n, -DOWN)], axis=1)


def lost(now: Any) -> np.ndarray[Any, Any]:
    """Fraction of the horizontal speed that the block has lost by the impact, (num_envs,)."""
    gone: np.ndarray[Any, Any] = 1.0 - now.read("qvel", "x")[:, 0] / now.parameters["speed"]
    return gone


study = stepper.lab.Study(
    name="block",
    model=model,
    start=thrown,
    outcomes=stepper.lab.Outcome(name="lost at the first touch", measure=lost, success=f"<= {LOSS}"),
    parameters={
        "friction": stepper.lab.Parameter("geom_friction[*][0]", nominal=THEORY, low=0.0, high=0.08, source="the exercise"),
        "speed": stepper.lab.Parameter("controller", nominal=SPEED, low=0.5, high=2.0, unit="m/s", source="the exercise"),
        "restitution": stepper.lab.Parameter("geom_restitution[block]", low=0.3, high=0.5, source="the exercise"),
    },
    seconds=0.3,  # after the first impact at 0.19 s, before the second at 0.39 s
    control=0.01,
    episodes=1,
)

if __name__ == "__main__":
    print(f"theory: mu = 0.1 v_x / ((1 + e) v_z) = {THEORY:.5f}")
    print(stepper.lab.sweep(study).document.markdown())
