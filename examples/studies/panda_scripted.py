"""Study of panda_trained.py with the script of panda.py, which gets the initial position of the cube.

Usage:

    stepper report examples/studies/panda_scripted.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import panda  # type: ignore[import-not-found]
import panda_hand as hand  # type: ignore[import-not-found]


class Scripted:
    """Scripted controller with the waypoints of panda.py, shifted to the initial position of the cube."""

    def begin(self, now: Any) -> None:
        """Store the hand's horizontal position, and the cube's displacement from the hand, both in world axes, m.

        The sensor measures the displacement in axes of the hand, whose y and x are the world's x and y.
        """
        self._hand = now.read("sensordata", "hand")[:, :2].copy()
        self._aside = now.read("sensordata", "cube")[:, [1, 0]].copy()

    def __call__(self, now: Any) -> Any:
        """Servo targets by the script for n environments, (n, 9): angles of seven joints (rad) and positions of two fingers (m)."""
        k, done = panda.way(now.time[0])
        height = panda.HALF + panda.HEIGHTS[k] + done * (panda.HEIGHTS[k + 1] - panda.HEIGHTS[k])
        place = self._hand + (done if k == 0 else 1.0) * self._aside
        target = np.concatenate([place, np.full((now.num_envs, 1), height)], axis=1)
        return hand.controls(target, now.time >= panda.TIMES[2])


study = hand.picking("panda_scripted", Scripted(), 0.02)
