"""Cost of derived quantities of all environments on one pinned core: mass matrix, forces, accelerations, and rays.

Usage:

    python benches/quantities.py
"""

import warnings

import mujoco
import numpy as np
import stepper
from derivatives import median_time, path_of
from stepper.doctor import cpu_levels
from stepper.shared.machine import cpu_name, one_core

ENVS = 256
RAYS = 187
SCENES = ("dm_control/humanoid", "dm_control/quadruped")
"""Scenes: a humanoid of capsules on a plane, and a quadruped on a height field of 201 by 201 points."""


def dynamics(sim: stepper.Stepper) -> list[float]:
    """Times of mass_matrix, qfrc_bias, qacc_smooth and inverse_dynamics after a change of the state, us per environment."""
    zeros, state = np.zeros(sim.model.nv), sim.get_state()
    calls = [sim.mass_matrix, lambda: sim.qfrc_bias, lambda: sim.qacc_smooth, lambda: sim.inverse_dynamics(zeros)]
    return [1e6 * median_time(call, 31, lambda: sim.set_state(state)) / ENVS for call in calls]


def rays(sim: stepper.Stepper, m: mujoco.MjModel) -> list[float]:
    """Times per ray, ns: `Stepper.rays` for all environments at once, and `mj_multiRay` for one environment and one origin."""
    points = np.random.default_rng(0).uniform(-1, 1, (RAYS, 3)) * [0.8, 0.5, 0.0] + [0, 0, 2.0]
    down = np.tile([0.0, 0.0, -1.0], (RAYS, 1))
    data, geoms, distances = mujoco.MjData(m), np.empty(RAYS, np.int32), np.empty(RAYS)
    mujoco.mj_forward(m, data)
    settings = (data, points[0], down.ravel(), None, 1, -1, geoms, distances, None, RAYS, 1e10)
    ours = median_time(lambda: sim.rays(points, down), 31) / (ENVS * RAYS)
    return [1e9 * ours, 1e9 * median_time(lambda: mujoco.mj_multiRay(m, *settings), 31) / RAYS]


def main() -> None:
    """Print a markdown table with the times of the derived quantities for each model and precision."""
    print(f"{cpu_name()}, CPU level {cpu_levels()[-1]}, {ENVS} environments, {RAYS} rays per environment\n")
    print("| | mass_matrix, us | qfrc_bias, us | qacc_smooth, us | inverse_dynamics, us | rays, ns each | mj_multiRay, ns each |")
    print("|---|---|---|---|---|---|---|")
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        for name in SCENES:
            m = mujoco.MjModel.from_xml_path(path_of(name))
            for precision in ("f64", "f32"):
                sim = stepper.Stepper(stepper.load(path_of(name)), ENVS, threads=1, precision=precision)
                sim.step(nstep=5)
                row = " | ".join([*(f"{x:.2f}" for x in dynamics(sim)), *(f"{x:.0f}" for x in rays(sim, m))])
                print(f"| {name}, {precision} | {row} |", flush=True)


if __name__ == "__main__":
    main()
