"""Effect of MuJoCo's friction cones on the policy of panda_trained.py, which drops cubes in MuJoCo at a friction of 0.5.

Usage:

    stepper sweep examples/studies/panda_cones.py --no-cliffs
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco

sys.path.insert(0, str(Path(__file__).resolve().parent))

import panda_hand as hand  # type: ignore[import-not-found]
from panda_trained import Trained  # type: ignore[import-not-found]

PYRAMIDAL = {"engine": "mujoco", "cone": "pyramidal"}


def scene() -> Any:
    """Scene with elliptic cones, so that MuJoCo and stepper with MuJoCo's contact law have the same cone."""
    model = hand.scene()
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    return model


picking = hand.picking("panda_cones", Trained(), hand.HOLD)
study = replace(
    picking,
    model=scene,
    parameters={"friction": replace(picking.parameters["friction"], values=(0.46, 0.5, 0.55))},
    settings={
        "MuJoCo's law, elliptic": {"contact": "mujoco"},
        "MuJoCo, elliptic": {"engine": "mujoco"},
        "MuJoCo, pyramidal": PYRAMIDAL,
        "MuJoCo, pyramidal, 1e-12": PYRAMIDAL | {"iterations": 200, "tolerance": 1e-12},
        "MuJoCo, pyramidal, noslip": PYRAMIDAL | {"noslip_iterations": 10},
    },
)
