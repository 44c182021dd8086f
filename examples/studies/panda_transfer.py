"""Parameters of a Panda arm, a cube and a camera that a scripted grasp depends on, for `stepper calibrate`.

Arm, gripper and cube are those of panda.py (`pip install --no-deps robosuite`). The script gets the position of the cube from a camera with
bias and noise. It presses with about 15 N, and lifts in a time that differs from run to run.

    stepper calibrate examples/studies/panda_transfer.py --margin 0.5
    stepper calibrate examples/studies/panda_transfer.py --margin 0.5 --setting "MuJoCo's law"

docs/benchmarks/reality.md has results.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from stepper.lab import Outcome, Parameter

sys.path.insert(0, str(Path(__file__).resolve().parent))

import panda  # type: ignore[import-not-found]
import panda_hand as hand  # type: ignore[import-not-found]

ABOVE, RISE = 0.06, 0.1
"""Initial height of the fingers above the centre of the cube, and height of the lift, m."""
DOWN, LIFTS = 0.4, 0.75
"""Ends of the descent and of the grasp, s."""
SLOWEST, FASTEST = 0.8, 0.4
"""Longest and shortest time of a lift, s."""
CLOSED = 0.01
"""Target of a closed finger, m. The servo presses with its stiffness, 1000 N/m, times the distance from the side of the cube, 0.025 m."""


class Lift:
    """Script that grasps the cube where the camera saw it, and lifts it with a speed that is drawn for each run."""

    def begin(self, now: Any) -> None:
        """Measures the position of the cube, (num_envs, 2), m, with the errors of the camera, and draws the time of the lift, s."""
        error = now.parameters["camera noise"][:, None] * now.rng("camera").normal(2)
        error[:, 0] += now.parameters["camera bias"]
        self._place = now.read("xpos", "cube")[:, :2] + error
        self._lasts = FASTEST + (SLOWEST - FASTEST) * now.rng("lift").uniform(0.0, 1.0, 1)[:, 0]

    def __call__(self, now: Any) -> Any:
        """Servo targets, (num_envs, 9): angles of seven joints (rad) and positions of two fingers (m)."""
        down, up = (np.clip(s, 0.0, 1.0) for s in (now.time / DOWN, (now.time - LIFTS) / self._lasts))
        height = panda.HALF + ABOVE * (1.0 - _smooth(down)) + RISE * _smooth(up)
        finger = np.where(now.time < DOWN, hand.OPEN, CLOSED)[:, None]
        arm = hand.arm(np.concatenate([self._place, height[:, None]], axis=1))
        return np.concatenate([arm, finger, -finger], axis=1)


def _smooth(s: Any) -> Any:
    """Fraction of a motion that begins and ends at rest, of the fraction of its time."""
    return 3 * s**2 - 2 * s**3


def start(now: Any, rngs: Any) -> Any:
    """Initial qpos and qvel: open fingers above the cube, which lies within 4 cm of its nominal position."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    qpos[:, 9:11] += np.array([rng.uniform(-hand.SPREAD, hand.SPREAD, 2) for rng in rngs])
    qpos[:, :7] = hand.arm(np.c_[qpos[:, 9:11], np.full(now.num_envs, panda.HALF + ABOVE)])
    qpos[:, 7], qpos[:, 8] = hand.OPEN, -hand.OPEN
    return qpos, np.zeros((now.num_envs, now.model.nv))


study = stepper.lab.Study(
    name="panda_transfer",
    model=hand.scene,
    controller=Lift(),
    start=start,
    outcomes=Outcome(name="rise", measure="body cube z", reduce="change", success=">= 0.07", unit="m"),
    parameters={
        "friction": Parameter(
            "geom_friction[cube,hand_finger*][0]", nominal=0.7, low=0.3, high=1.1, source="rubber and plastics, dusty to clean"
        ),
        "cube mass": Parameter(
            "body_mass[cube]", operation="scale", nominal=0.8, low=0.5, high=1.1, source="0.8 to 1.76 kg: empty to full"
        ),
        "grip": Parameter(
            "actuator_kp[*finger*]", operation="scale", nominal=1.0, low=0.75, high=1.25, source="forces of grippers, cold to hot motors"
        ),
        "arm stiffness": Parameter("actuator_kp[torq*]", operation="scale", low=0.5, high=1.5, source="usual gains"),
        "finger friction": Parameter("dof_frictionloss[hand_finger*]", low=0.0, high=2.0, nominal=1.0, unit="N", source="worn gears"),
        "motor delay": Parameter("actuator.delay", low=0.0, high=0.02, nominal=0.004, unit="s", source="buses, 0 to 20 ms"),
        "camera bias": Parameter("controller", low=-0.02, high=0.02, nominal=0.0, unit="m", source="a bracket, by eye"),
        "camera noise": Parameter("controller", low=0.0, high=0.004, nominal=0.001, unit="m", source="detectors of markers"),
    },
    settings={"MuJoCo's law": {"contact": "mujoco"}},
    options=stepper.Options(timestep=0.005),
    seconds=1.6,
    control=0.02,
    episodes=4,
    batch=512,
)
