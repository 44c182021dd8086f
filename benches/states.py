"""What it costs to keep a state and to go back to it, beside a step: dm_control's quadruped on the floor, one pinned core.

python benches/states.py
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import stepper
from derivatives import median_time, touching
from stepper import Options
from stepper.shared.machine import cpu_name, one_core


def main() -> None:
    """Prints the table."""
    print(f"{cpu_name()}, CPU level {stepper.cpu_levels()[-1]}\n")
    print("| environments | bytes of a state, each | a step, us each | get_state() | set_state(state) | set_state(qpos, qvel) |")
    print("|---|---|---|---|---|---|")
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        for num_envs in (1, 32, 1024):
            sim, ctrl = touching("dm_control/quadruped", Options(), num_envs)
            state, qpos, qvel = sim.get_state(), np.array(sim.qpos), np.array(sim.qvel)

            def back(sim: stepper.Stepper = sim, state: stepper.State = state) -> None:
                sim.set_state(state)

            calls: list[tuple[Callable[[], Any], Callable[[], Any]]] = [
                (lambda sim=sim, ctrl=ctrl: sim.step(ctrl), back),
                (sim.get_state, lambda: None),
                (back, lambda: None),
                (lambda sim=sim, qpos=qpos, qvel=qvel: sim.set_state(qpos, qvel), lambda: None),
            ]
            times = [1e6 * median_time(call, 31, before) / num_envs for call, before in calls]
            print(f"| {num_envs} | {state.nbytes / num_envs:.0f} | " + " | ".join(f"{each:.2f}" for each in times) + " |", flush=True)


if __name__ == "__main__":
    main()
