"""Study of real tosses of a cube: which parameters must be fitted to predict the pose.

The folder of data has cube_toss/cube_toss.npz. A third of the tosses with even numbers come first, then those with odd numbers:

    PYTHONPATH=benches stepper calibrate benches/studies/cube_toss.py --data FOLDER --fit-trajectories 92 --margin 0.01
"""

from pathlib import Path
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from reality.data import HALF, PERIOD, cube_tosses, turn
from reality.engines import Table, states
from stepper.lab import Outcome, Parameter

Array = NDArray[np.float64]


def study(data: Path) -> stepper.lab.Study:
    """Study of tosses in a folder of data. The error is that of the published comparison, a mean over time of d^2 / 0.0524 m + theta^2."""
    every = cube_tosses(data)
    every = every[::6] + every[1::2]
    qpos, qvel = states(every)
    lengths = np.array([len(toss.pose) for toss in every])
    # The last pose is repeated, with a weight of 0.
    poses = np.array([toss.pose[np.minimum(np.arange(lengths.max()), len(toss.pose) - 1)] for toss in every])

    def error(now: Any) -> Array:
        """Error of the pose. The weight makes the mean over the longest toss the mean over each."""
        which, k = now.episodes, round(float(now.time[0]) / PERIOD)
        real = poses[which, k]
        weight = np.where(k < lengths[which], poses.shape[1] / lengths[which], 0.0)
        distance, angle = np.linalg.norm(now.qpos[:, :3] - real[:, :3], axis=1), turn(now.qpos[:, 3:], real[:, 3:])
        return np.asarray(weight * (distance**2 / HALF + angle**2))

    return stepper.lab.Study(
        name="cube_toss",
        model=stepper.load(Table().mjcf('friction="0.2 0 0"')),
        controller=None,
        start=lambda now, _: (qpos[now.episodes], qvel[now.episodes]),
        outcomes=Outcome(name="error", measure=error, reduce="mean"),
        parameters={
            "friction": Parameter("geom_friction[0,1][0]", nominal=0.2, low=0.05, high=0.4, source="wide"),
            "restitution": Parameter("geom_restitution[0,1]", nominal=0.0, low=0.0, high=0.6, source="wide"),
            "gravity": Parameter("gravity[2]", nominal=-9.81, low=-9.85, high=-9.5, unit="m/s2", source="free flights"),
            "height of the table": Parameter("geom_pos[0][2]", nominal=0.0, low=-0.004, high=0.001, unit="m", source="cube at rest"),
        },
        options=stepper.Options(timestep=PERIOD / 4),
        control=PERIOD,
        seconds=(poses.shape[1] - 1) * PERIOD,
        episodes=len(every),
        batch=2048,
    )
