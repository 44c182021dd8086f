"""Parameters of a Panda arm, a cube and a camera that a scripted grasp depends on, for `stepper calibrate`.

Arm, cube and script are those of panda_scripted.py (`pip install --no-deps robosuite`). The script gets the position of the cube from a
camera with bias and noise.

    stepper calibrate examples/studies/panda_transfer.py --margin 0.15
    stepper calibrate examples/studies/panda_transfer.py --margin 0.15 --setting "MuJoCo's law"
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from stepper.lab import Parameter

sys.path.insert(0, str(Path(__file__).resolve().parent))

import panda_hand  # type: ignore[import-not-found]
from panda_scripted import Scripted  # type: ignore[import-not-found]


class Camera(Scripted):  # type: ignore[misc]
    """Script that measures the initial position of the cube by a camera with a bias in x and noise."""

    def begin(self, now: Any) -> None:
        """Adds the errors of the camera to the measured position of the cube, m."""
        super().begin(now)
        self._aside += now.parameters["camera noise"][:, None] * now.rng("camera").normal(2)
        self._aside[:, 0] += now.parameters["camera bias"]


study = replace(
    panda_hand.picking("panda_transfer", Camera(), 0.02),
    episodes=6,
    batch=512,
    parameters={
        "friction": Parameter(
            "geom_friction[cube,hand_finger*][0]", nominal=0.7, low=0.3, high=1.1, source="rubber and plastics, dusty to clean"
        ),
        "cube mass": Parameter("body_mass[cube]", operation="scale", low=0.7, high=1.3, source="empty to full"),
        "grip": Parameter("actuator_kp[*finger*]", operation="scale", low=0.5, high=1.5, source="stiffness of the fingers' servos"),
        "arm stiffness": Parameter("actuator_kp[torq*]", operation="scale", low=0.5, high=1.5, source="usual gains"),
        "joint damping": Parameter("dof_damping[joint*]", operation="scale", low=0.5, high=2.0, source="grease of gears, warm to cold"),
        "finger friction": Parameter("dof_frictionloss[hand_finger*]", low=0.0, high=2.0, nominal=1.0, unit="N", source="worn gears"),
        "motor delay": Parameter("actuator.delay", low=0.0, high=0.02, nominal=0.004, unit="s", source="buses, 0 to 20 ms"),
        "camera bias": Parameter("controller", low=-0.02, high=0.02, nominal=0.0, unit="m", source="a bracket, by eye"),
        "camera noise": Parameter("controller", low=0.0, high=0.004, nominal=0.001, unit="m", source="detectors of markers"),
    },
    settings={"MuJoCo's law": {"contact": "mujoco"}},
)
