"""Friction threshold of a grasp: two pads close on a box and lift it by 10 cm; below mu = m (g + a) / (2 F) it slips.

m is the mass of the box, a the acceleration of the lift, F the force of each pad. A contact uses the larger friction of its two geoms.
The friction of the box has no effect if that of the pads is larger, so the study varies both together.

    stepper sweep examples/studies/grasp.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper

G, MASS, FORCE = 9.81, 0.8, 10.0
HAND, FINGER = 1.0, 0.1
CLOSE, LIFT, HEIGHT = 0.2, 0.4, 0.1
"""Duration of the closing, s; duration of the lift, s; height of the lift, m."""
ACCELERATION = 4.0 * HEIGHT / LIFT**2
"""Acceleration of the lift, m/s^2: upwards in its first half, downwards in its second."""
THEORY = MASS * (G + ACCELERATION) / (2.0 * FORCE)

MODEL = f"""
<mujoco model="grasp">
  <option timestep="0.002" gravity="0 0 -{G}"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="hand" pos="0 0 0.05">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0.1" mass="{HAND}" diaginertia="0.01 0.01 0.01"/>
      <body name="left" pos="-0.045 0 0"><joint name="left" type="slide" axis="1 0 0"/>
        <geom name="left_pad" type="box" size="0.01 0.02 0.02" mass="{FINGER}"/></body>
      <body name="right" pos="0.045 0 0"><joint name="right" type="slide" axis="-1 0 0"/>
        <geom name="right_pad" type="box" size="0.01 0.02 0.02" mass="{FINGER}"/></body>
    </body>
    <body name="box" pos="0 0 0.05"><freejoint/><geom name="box" type="box" size="0.03 0.03 0.05" mass="{MASS}"/></body>
  </worldbody>
  <actuator><motor joint="lift"/><motor joint="left"/><motor joint="right"/></actuator>
</mujoco>
"""


def lift(now: Any) -> np.ndarray[Any, Any]:
    """Controls (3,), N: the pads close first; then the hand lifts with the force that accelerates hand, pads and box."""
    t = now.time[0] + 1e-9
    if t < CLOSE:
        vertical = (HAND + 2 * FINGER) * G
    else:
        phase = t - CLOSE
        a = ACCELERATION if phase < LIFT / 2 else -ACCELERATION if phase < LIFT else 0.0
        vertical = (HAND + 2 * FINGER + MASS) * (G + a)
    return np.array([vertical, FORCE, FORCE])


def slip(now: Any) -> np.ndarray[Any, Any]:
    """Slip of the box: its distance below the hand, m."""
    fallen: np.ndarray[Any, Any] = now.read("xpos", "hand")[:, 2] - now.read("xpos", "box")[:, 2]
    return fallen


study = stepper.lab.Study(
    name="grasp",
    model=MODEL,
    controller=lift,
    outcomes=[
        stepper.lab.Outcome(name="slip", measure=slip, reduce="max", success="<= 0.0005", unit="m"),
        stepper.lab.Outcome(
            name="force at a pad", measure=lambda now: np.abs(now.read("body_contact_force", "left")[:, 0]), reduce="end", unit="N"
        ),
        stepper.lab.Outcome(name="rise", measure="body box z", reduce="change", unit="m"),
    ],
    parameters={
        "friction": stepper.lab.Parameter(
            "geom_friction[box,*_pad][0]",
            values=tuple(float(x) for x in np.linspace(0.2, 1.0, 9).round(3)),
            source="rubber and plastics, dry: 0.2 to 1.0",
        )
    },
    settings={
        "20 iterations": {"iterations": 20},
        "5 iterations": {"iterations": 5},
        "MuJoCo's law": {"contact": "mujoco"},
        "MuJoCo": {"engine": "mujoco"},
        "MuJoCo, elliptic, impratio 10": {"engine": "mujoco", "cone": "elliptic", "impratio": 10.0},
    },
    seconds=0.8,
    control=0.02,
    episodes=1,
)

if __name__ == "__main__":
    found = stepper.lab.sweep(study).sweep
    print(f"theory: mu = m (g + a) / (2 F) = {THEORY:.4f}, a = {ACCELERATION:g} m/s^2, F = {FORCE:g} N")
    for cliff in found.cliffs:
        middle = (cliff.low + cliff.high) / 2
        print(f"{cliff.setting:32} {middle:.4f} +- {(cliff.high - cliff.low) / 2:.4f}, {100 * (middle / THEORY - 1):+.2f} %")
