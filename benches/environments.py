"""Environment steps per second, with observations, rewards and resets, and the time of a step outside the physics.

All engines run the same tasks with random actions, Gymnasium's default autoreset mode and one core:

* stepper's vector environments;
* EnvPool, with one thread and the number of environments at which it is fastest;
* Gymnasium's environments in a `SyncVectorEnv`, with few environments, as its speed does not depend on their number;
* stepper's task code over `mujoco.batch`.

The engines take turns, and the results are medians of processor time, so that other load on the machine affects all engines alike.

    pip install envpool imageio                         # Gymnasium needs imageio; missing libraries are skipped
    python benches/environments.py                      # HalfCheetah, Hopper, Ant, Humanoid with 1,024 environments
    python benches/environments.py Walker2d --num-envs 256 --seconds 2
"""

import argparse
import importlib
import time
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import gymnasium
import mujoco_vector
import numpy as np
from gymnasium.vector import SyncVectorEnv
from sections import Table
from stepper.envs import TASKS, StepperVectorEnv, Task, TaskView
from stepper.shared.machine import cpu_name, one_core

NAMES = ("HalfCheetah", "Hopper", "Ant", "Humanoid")
GYMNASIUMS, ENVPOOLS = 16, 256
"""Numbers of environments of Gymnasium's and of EnvPool's batch. More do not increase their speed."""
LIMIT = 1000
"""Number of actions in an episode."""
BESIDE = ("EnvPool", "mujoco.batch", "Gymnasium's own")
"""Reference engines. The table has a column for each, with the speed of the row's engine divided by that of the reference engine."""
TURN = 0.15
"""Processor time of a turn, in which one batch is stepped, s."""


class Contender:
    """Batch of environments in this process, with its step times.

    Args:
        envs: Vector environment.
        num_envs: Number of its environments.
        physics: List to which each step appends its physics time, s. None if unknown.
    """

    def __init__(self, envs: Any, num_envs: int, physics: list[float] | None = None):
        # EnvPool's `action_space` is that of a single environment.
        space = getattr(envs, "single_action_space", envs.action_space)
        self._actions = np.random.default_rng(0).uniform(space.low, space.high, (50, num_envs, *space.shape)).astype(space.dtype)
        self._envs, self._num_envs, self._physics = envs, num_envs, [float("nan")] if physics is None else physics
        self._times: list[float] = []
        self._inner: list[float] = []
        envs.reset()

    def turn(self) -> None:
        """Step the environments for the duration of one measurement turn, and store the times of all steps but the first."""
        end = time.process_time() + TURN
        # The first step of each turn is not counted: its data are not in the CPU caches.
        self._step()
        timed = 0
        while time.process_time() < end or not timed:
            self._times.append(self._step())
            self._inner.append(self._physics[-1])
            timed += 1

    def _step(self) -> float:
        """Step all environments once with random actions, and return the processor time, s."""
        action = self._actions[len(self._times) % len(self._actions)]
        begin = time.process_time()
        self._envs.step(action)
        return time.process_time() - begin

    @property
    def rate(self) -> float:
        """Environment steps per second."""
        return self._num_envs / float(np.median(self._times))

    @property
    def layer(self) -> tuple[float, float]:
        """Time of a step outside the physics: ratio to the time of the physics, and time per environment step, us."""
        physics = np.array(self._inner)
        layer = np.array(self._times) - physics
        return float(np.median(layer / physics)), float(np.median(layer)) / self._num_envs * 1e6


def ours(name: str, num_envs: int, contact: str, precision: str) -> Contender:
    """Batch of stepper's environments. The time of `Task.advance` counts as physics."""
    kind: Any = TASKS[name]
    times: list[float] = []

    def advance(self: Task, now: TaskView) -> None:
        begin = time.process_time()
        kind.advance(self, now)
        times.append(time.process_time() - begin)

    task: Task = type(name, (kind,), {"advance": advance})()
    settings: dict[str, Any] = {"contact": contact, "precision": precision}
    return Contender(StepperVectorEnv(task, num_envs, max_episode_steps=LIMIT, **settings), num_envs, times)


def batches(name: str, num_envs: int) -> Contender:
    """Batch of environments with stepper's task code and the physics of `mujoco.batch`."""
    return Contender(mujoco_vector.MujocoVectorEnv(name, num_envs, max_episode_steps=LIMIT), num_envs)


def envpools(name: str) -> Contender:
    """Batch of EnvPool's environments, on one thread."""
    envpool: Any = importlib.import_module("envpool")
    return Contender(envpool.make_gymnasium(f"{name}-v5", num_envs=ENVPOOLS, num_threads=1, seed=0), ENVPOOLS)


def gymnasiums(name: str) -> Contender:
    """Batch of Gymnasium's environments in a `SyncVectorEnv`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Contender(SyncVectorEnv([lambda: gymnasium.make(f"{name}-v5", disable_env_checker=True)] * GYMNASIUMS), GYMNASIUMS)


def main() -> None:
    """Print a markdown table with the environment steps per second of each library for each task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=NAMES, metavar="TASK", help=f"one of {', '.join(sorted(TASKS))}")
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=5.0, help="processor time of each row, s [5]")
    given = parser.parse_args()
    print(f"{given.num_envs} environments, one core of {cpu_name()}\n")
    speedups = ("x EnvPool", "x mujoco.batch", "x Gymnasium")
    table = Table("task", "contact", "precision", "steps/s", *speedups, "overhead / physics", "overhead, us/step")
    peers: dict[str, tuple[str, Callable[[str], Contender]]] = {
        "Gymnasium's own": ("imageio", gymnasiums),
        "EnvPool": ("envpool", envpools),
    }
    with one_core():
        for name in given.names:
            rows = {(peer, "f64"): make(name) for peer, (needed, make) in peers.items() if find_spec(needed)}
            rows["mujoco.batch", "f64"] = batches(name, given.num_envs)
            ours_too = {
                (contact, precision): ours(name, given.num_envs, contact, precision)
                for contact in ("mujoco", "hard")
                for precision in ("f64", "f32")
            }
            rows |= ours_too
            for _ in range(max(1, round(given.seconds / TURN))):
                for contender in rows.values():
                    contender.turn()
            for key, contender in rows.items():
                beside = [f"{contender.rate / rows[peer, 'f64'].rate:.1f}" if (peer, "f64") in rows else "" for peer in BESIDE]
                share, spent = contender.layer if key in ours_too else (float("nan"), float("nan"))
                layer = (f"{share:.0%}", f"{spent:.2f}") if key in ours_too else ("", "")
                table.add(name, *key, f"{contender.rate:,.0f}", *beside, *layer)


if __name__ == "__main__":
    main()
