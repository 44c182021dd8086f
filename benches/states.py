"""Cost of saving and restoring states, compared with a step: dm_control's quadruped on the floor, one pinned core.

Usage:

    python benches/states.py          # states of the whole batch: docs/benchmarks/performance.md
    python benches/states.py --some   # states of single environments: docs/benchmarks/components.md
"""

import argparse
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import stepper
from derivatives import median_time, touching
from stepper import Options
from stepper.doctor import cpu_levels
from stepper.shared.machine import cpu_name, one_core


def some(num_envs: int = 256) -> None:
    """Print the time to save, restore and copy states of single environments, compared with the time of a step."""
    sim, ctrl = touching("dm_control/quadruped", Options(), num_envs)
    begin, kept = sim.get_state(), [sim.get_state(env) for env in range(num_envs)]
    sources = np.random.default_rng(0).integers(0, num_envs, num_envs)

    def back() -> None:
        sim.set_state(begin)

    rows: dict[str, Callable[[], Any]] = {
        "a step": lambda: sim.step(ctrl),
        "a step of the first quarter": lambda: sim.step(ctrl, envs=np.arange(num_envs) < num_envs // 4),
        "a step of every fourth": lambda: sim.step(ctrl, envs=np.arange(num_envs) % 4 == 0),
        "sim.copy_state(sources) from random sources": lambda: sim.copy_state(sources),
        "sim.get_state(env) of each": lambda: [sim.get_state(env) for env in range(num_envs)],
        "sim.set_state(states) of all": lambda: sim.set_state(kept),
        "sim.get_state()": sim.get_state,
        "sim.set_state(kept)": back,
    }
    print(f"| {num_envs} environments | us per environment |\n|---|---|")
    for name, call in rows.items():
        print(f"| {name} | {1e6 * median_time(call, 31, back) / num_envs:.1f} |", flush=True)


def whole() -> None:
    """Print the time to save and restore the state of all environments, compared with the time of a step."""
    print(f"{cpu_name()}, CPU level {cpu_levels()[-1]}\n")
    print("| environments | state, bytes each | step, us each | get_state() | set_state(state) | set_state(qpos, qvel) |")
    print("|---|---|---|---|---|---|")
    for num_envs in (1, 32, 1024):
        sim, ctrl = touching("dm_control/quadruped", Options(), num_envs)
        state, qpos, qvel = sim.get_state(), np.array(sim.qpos), np.array(sim.qvel)

        def back(sim: stepper.Stepper = sim, state: stepper.State = state) -> None:
            sim.set_state(state)

        times = [
            median_time(lambda sim=sim, ctrl=ctrl: sim.step(ctrl), 31, back), median_time(sim.get_state, 31), median_time(back, 31),
            median_time(lambda sim=sim, qpos=qpos, qvel=qvel: sim.set_state(qpos, qvel), 31),
        ]  # fmt: skip
        columns = " | ".join(f"{1e6 * each / num_envs:.2f}" for each in times)
        print(f"| {num_envs} | {state.nbytes / num_envs:.0f} | {columns} |", flush=True)


def main() -> None:
    """Print a markdown table with the time to save and restore states, compared with a step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--some", action="store_true", help="measure states of single environments")
    given = parser.parse_args()
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        some() if given.some else whole()


if __name__ == "__main__":
    main()
