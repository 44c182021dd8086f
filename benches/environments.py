"""Environment steps per second, observations, rewards and resets included, and how much of the time is not physics.

Random actions, with the autoreset of Gymnasium's default, on one core. Beside it stands Gymnasium's own environment in its `SyncVectorEnv`,
of fewer environments, as each takes the same time; it needs imageio.

    python benches/environments.py                      # HalfCheetah, Hopper, Ant with 1,024 environments
    python benches/environments.py Walker2d --num-envs 256
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from stepper.envs import TASKS, Moment, StepperVectorEnv, Task
from stepper.shared.machine import allowed_cores

NAMES = ("HalfCheetah", "Hopper", "Ant")
PEERS = 16
"""Environments of Gymnasium's own."""
LIMIT = 1000
"""Actions of an episode."""


@dataclass
class Speed:
    """A measurement.

    Attributes:
        rate: Environment steps per second.
        layer: Share of the time outside of `Task.advance`.
        layer_time: The same in microseconds, for each step of an environment.
    """

    rate: float
    layer: float = float("nan")
    layer_time: float = float("nan")


def timed(name: str) -> tuple[Task, list[float]]:
    """A task, and the list to which it adds how long each call of `advance` took, s."""
    kind: Any = TASKS[name]
    times: list[float] = []

    def advance(self: Task, now: Moment) -> None:
        begin = time.process_time()
        kind.advance(self, now)
        times.append(time.process_time() - begin)

    task: Task = type(name, (kind,), {"advance": advance})()
    return task, times


def ours(name: str, num_envs: int, seconds: float, **settings: Any) -> Speed:
    """A batch of stepper's: medians over its calls, but for the first tenth."""
    task, physics = timed(name)
    envs = StepperVectorEnv(task, num_envs, max_episode_steps=LIMIT, **settings)
    actions = _actions(envs)
    envs.reset(seed=0)
    whole: list[float] = []
    end = time.process_time() + seconds
    while time.process_time() < end:
        action = actions[len(whole) % len(actions)]
        begin = time.process_time()
        envs.step(action)
        whole.append(time.process_time() - begin)
    kept = slice(len(whole) // 10, None)
    total, inner = np.array(whole[kept]), np.array(physics[kept])
    layer = float(np.median(total - inner))
    return Speed(num_envs / float(np.median(total)), float(np.median((total - inner) / total)), layer / num_envs * 1e6)


def gymnasiums(name: str, seconds: float) -> Speed:
    """Gymnasium's own environments, one after the other."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        envs = SyncVectorEnv([lambda: gymnasium.make(f"{name}-v5", disable_env_checker=True)] * PEERS)
    actions = _actions(envs)
    envs.reset(seed=0)
    count, begin = 0, time.process_time()
    while time.process_time() < begin + seconds:
        envs.step(actions[count % len(actions)])
        count += 1
    return Speed(count * PEERS / (time.process_time() - begin))


def _actions(envs: Any) -> Any:
    """Random actions, drawn before anything is measured: (50, num_envs, nu)."""
    space = envs.single_action_space
    return np.random.default_rng(0).uniform(space.low, space.high, (50, *envs.action_space.shape)).astype(np.float32)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=NAMES, metavar="TASK", help=f"one of {', '.join(sorted(TASKS))}")
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each measurement")
    given = parser.parse_args()
    print(f"{given.num_envs} environments, {len(allowed_cores())} core(s) allowed, one used\n")
    print("| task | contact | precision | steps/s | beside Gymnasium's | layer | layer, us a step |")
    print("|---|---|---|---|---|---|---|")
    for name in given.names:
        peer = gymnasiums(name, given.seconds) if find_spec("imageio") else Speed(float("nan"))
        print(f"| {name} | Gymnasium's own | f64 | {peer.rate:,.0f} | 1 | | |", flush=True)
        for contact in ("mujoco", "hard"):
            for precision in ("f64", "f32"):
                speed = ours(name, given.num_envs, given.seconds, contact=contact, precision=precision)
                ratio = f"{speed.rate / peer.rate:.1f}"
                print(
                    f"| {name} | {contact} | {precision} | {speed.rate:,.0f} | {ratio} | {speed.layer:.1%} | {speed.layer_time:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
