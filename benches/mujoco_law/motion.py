"""Table of the time for which motion with MuJoCo's contact law in stepper agrees with motion in MuJoCo, before chaos separates both."""

import argparse
import warnings
from statistics import median
from typing import Any

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray

from mujoco_law.models import Source, sources

Array = NDArray[np.float64]

TASKS = (
    "half_cheetah",
    "hopper",
    "walker2d_v5",
    "ant",
    "humanoid",
    "humanoidstandup",
    "swimmer",
    "inverted_pendulum",
    "reacher",
    "pusher_v5",
)
"""Models of Gymnasium's tasks."""
BOUNDS = (1e-6, 1e-3)
"""Bounds of the difference of configurations, rad or m, for which the table has the time until two motions differ by more."""
HOLD = 5
"""Number of steps per random control."""
NOISE = 0.01
"""Standard deviation of the initial configuration about the reference configuration, rad or m."""


def main() -> None:
    """Measure for all models how long motions in stepper and in MuJoCo agree, and print the table."""
    parser = argparse.ArgumentParser(prog="mujoco_law.motion", description=__doc__)
    parser.add_argument("--episodes", type=int, default=20, help="number of episodes of each model [20]")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of an episode, s [10]")
    args = parser.parse_args()
    print("| model | dt ms | s to 1e-6 | s to 1e-3 | MuJoCo solved to 1e-14: s to 1e-6 | s to 1e-3 |")
    print("|---|---|---|---|---|---|")
    for source in sources([f"gymnasium {name}" for name in TASKS]):
        if source.name.split()[1] in TASKS:
            print(_line(source, args.episodes, args.seconds), flush=True)


def _line(source: Source, episodes: int, seconds: float) -> str:
    """Row of the markdown table for a model: times after which its motions in MuJoCo and in stepper differ by more than given bounds, s."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        compiled = mujoco.MjModel.from_xml_path(str(source.path))
        model = stepper.load(compiled, strict=False)
    cells = []
    for exact in (False, True):
        if exact:
            compiled.opt.solver, compiled.opt.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, 1e-14
            compiled.opt.iterations, compiled.opt.ls_tolerance = 200, 1e-8
        apart = _apart(compiled, model, episodes, round(seconds / compiled.opt.timestep))
        for bound in BOUNDS:
            times = [_first(difference > bound) * compiled.opt.timestep for difference in apart.T]
            cells.append(f"{median(times):.2g}" if median(times) < seconds else f"over {seconds:g}")
    return f"| {source.name} | {1e3 * compiled.opt.timestep:g} | {' | '.join(cells)} |"


def _first(parted: NDArray[np.bool_]) -> int:
    """Index of the first true entry of a mask, or the number of entries if there is none."""
    return int(np.argmax(parted)) if parted.any() else len(parted)


def _apart(compiled: Any, model: stepper.Model, episodes: int, steps: int) -> Array:
    """Largest difference between the configurations of MuJoCo and of stepper, after each step of each episode.

    Both engines start from the same random states and receive the same random controls. Returns an array (steps, episodes), rad or m.
    """
    rng = np.random.default_rng(0)
    start = compiled.qpos0 + rng.normal(0.0, NOISE, (episodes, compiled.nq))
    low, high = np.where(compiled.actuator_ctrllimited[:, None].astype(bool), compiled.actuator_ctrlrange, [-1.0, 1.0]).T
    controls = rng.uniform(low, high, (steps // HOLD + 1, episodes, compiled.nu))
    options = stepper.Options(contact="mujoco", tolerance=1e-12, iterations=100)
    sim = stepper.Stepper(model, num_envs=episodes, options=options)
    sim.set_state(qpos=start)
    start = np.array(sim.qpos)
    ours = np.empty((steps, *start.shape))
    for k in range(steps):
        sim.step(controls[k // HOLD])
        ours[k] = sim.qpos
    theirs, data = np.empty_like(ours), mujoco.MjData(compiled)
    for env in range(episodes):
        mujoco.mj_resetData(compiled, data)
        data.qpos[:] = start[env]
        for k in range(steps):
            data.ctrl[:] = controls[k // HOLD, env]
            mujoco.mj_step(compiled, data)
            theirs[k, env] = data.qpos
    difference: Array = np.abs(ours - theirs).max(axis=2)
    return difference


if __name__ == "__main__":
    main()
