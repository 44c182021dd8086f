"""Study of real tosses of a cube: which parameters must be fitted to predict its motion.

The environment variable STEPPER_DATA names the folder that has cube_toss/cube_toss.npz. The first 69 episodes are tosses with even numbers,
the other 69 tosses with odd numbers, a quarter of all:

    STEPPER_DATA=data PYTHONPATH=benches stepper calibrate benches/studies/cube_toss.py --recordings 69 --margin 0.02
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from reality.engines import Table
from reality.recordings import HALF, PERIOD, cube_tosses, turn
from stepper.lab import Outcome, Parameter

Array = NDArray[np.float64]


def tosses(folder: Path) -> stepper.lab.Study:
    """Study of a quarter of the tosses in a data folder."""
    every = cube_tosses(folder)
    own = [*every[0:550:8], *every[1:550:8]]
    samples = max(len(toss.pose) for toss in own)
    starts, lengths = np.array([toss.start for toss in own]), np.array([len(toss.pose) for toss in own])
    poses = np.array([np.pad(toss.pose, ((0, samples - len(toss.pose)), (0, 0)), mode="edge") for toss in own])

    def start(now: Any, _: Any) -> tuple[Array, Array]:
        qpos = starts[now.episodes, :7].copy()
        qpos[:, 2] -= now.parameters["table height"]
        return qpos, starts[now.episodes, 7:]

    def error(now: Any) -> Array:
        k, which = round(float(now.time[0]) / PERIOD), now.episodes
        far = now.qpos[:, :3] - poses[which, k, :3]
        far[:, 2] += now.parameters["table height"]
        found = (far**2).sum(axis=1) / HALF + turn(now.qpos[:, 3:], poses[which, k, 3:]) ** 2
        # The mean over all samples of the study is then the mean over the samples of the toss.
        return np.where(k < lengths[which], found * samples / lengths[which], 0.0)

    return stepper.lab.Study(
        name="cube_toss",
        model=Table().mjcf(""),
        start=start,
        outcomes=Outcome(name="error", measure=error, reduce="mean"),
        parameters={
            "friction": Parameter("geom_friction[*][0]", nominal=0.5, low=0.08, high=0.6, source="plastics; nominal: a usual guess"),
            "restitution": Parameter("geom_restitution[*]", nominal=0.0, low=0.0, high=0.5, source="plastics; nominal: none"),
            "gravity": Parameter("gravity[2]", nominal=-9.81, low=-9.9, high=-9.5, unit="m/s2", source="errors of the clock and scale"),
            "table height": Parameter("controller", nominal=0.0, low=-0.004, high=0.001, unit="m", source="depth of the cube at rest"),
        },
        options=stepper.Options(timestep=PERIOD / 4),
        seconds=(samples - 1) * PERIOD,
        control=PERIOD,
        episodes=len(own),
        batch=552,
    )


if "STEPPER_DATA" in os.environ:
    study = tosses(Path(os.environ["STEPPER_DATA"]))
