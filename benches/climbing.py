"""Evaluation of a policy of `stepper/Go1Rough-v0` in several simulators: climbing of stairs, and returns in the task.

    python examples/train_stairs.py
    python benches/climbing.py out/train/stairs/stage3/policy.npz

The script prints two tables. The first has the fraction of episodes in which the robot climbs five steps out of a pit in 20 s. The robot
starts at a random heading, and is commanded to turn to the x axis and to walk along it. The second table has returns in the task itself,
with all its randomisation and the reward weights of the policy's training. Episodes end early after a fall, or when the robot leaves the
terrain.
"""

import argparse
import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco_vector
import numpy as np
from sections import Table, write_section
from stepper import Options
from stepper.envs.commands import VelocityCommand
from stepper.envs.locomotion import Go1Rough
from stepper.envs.locomotion.velocity import ROUGH
from stepper.envs.task import Array, TaskView, Terms
from stepper.envs.terrain import PyramidStairs, Terrain
from stepper.policies import evaluate, load

PAGE = Path(__file__).parents[1] / "docs/benchmarks/training.md"
HEIGHTS = (0.05, 0.1, 0.15, 0.2)
"""Heights of the steps, m."""
SPEED = 0.7
"""Commanded velocity, straight ahead, m/s."""
OUTSIDE = 3.3
"""Distance of the base from the middle of the pit in x or y, m, at which a robot has climbed all steps.

The pit's edge is at 3 m, and half a robot is 0.3 m long.
"""


def simulators() -> dict[str, tuple[str, dict[str, Any]]]:
    """Simulators of the tables by label: namespace of the environment's id, and arguments of the environment.

    The time step is 5 ms, that of the task, or 1.25 ms with four times as many steps per action.
    """
    law = Options.from_model(Go1Rough().model())
    hard, soft = ({"options": dataclasses.replace(options, timestep=0.00125), "frame_skip": 16} for options in (Options(), law))
    return {
        "hard contact, 5 ms": ("stepper", {}),
        "hard contact, 1.25 ms": ("stepper", hard),
        "MuJoCo's law, 5 ms": ("stepper", {"contact": "mujoco"}),
        "MuJoCo's law, 1.25 ms": ("stepper", soft),
        "`mujoco.batch`, 5 ms": ("mujoco_batch", {}),
    }


ALONG_X = VelocityCommand(x=(SPEED, SPEED), yaw=(-0.5, 0.5), turning=1.0, heading=(0.0, 0.0))
"""Command to turn to the x axis and to walk along it for the whole episode."""
EPISODE_STEPS = 1000
"""Number of actions of an episode."""


@dataclass(frozen=True, kw_only=True)
class Go1Climb(Go1Rough):
    """Task in which the quadruped starts in a pit, turns to the x axis and walks along it.

    An episode is truncated when the robot has left the pit.
    """

    twist: VelocityCommand = ALONG_X

    def truncated(self, now: TaskView) -> Array:
        """Whether a robot has climbed all steps, (num_envs,)."""
        return np.asarray(np.abs(now.qpos[:, :2]).max(axis=1) > OUTSIDE)

    def info(self, now: TaskView) -> Terms:
        """Info of `Go1Rough`, with "climbed": 1 if the robot has climbed all steps, else 0."""
        return super().info(now) | {"climbed": self.truncated(now).astype(np.float64)}


def pit(height: float) -> Terrain:
    """Terrain with a square pit, whose bottom is 3 m wide. On each side, five steps with treads of 0.3 m lead out.

    `height` is the height of a step, m.
    """
    stairs = PyramidStairs(step_height_range=(height, height), inverted=True)
    return Terrain(sub_terrains={"stairs": stairs}, num_rows=1, border_width=4.0)


def climbs(policy: Any, episodes: int) -> Table:
    """Table of climbing: the fraction of episodes in which the robot leaves the pit.

    Rows are simulators, and columns heights of a step.
    """
    gymnasium.register(
        "stepper/Go1Climb-v0",
        vector_entry_point="stepper.envs:StepperVectorEnv",
        max_episode_steps=EPISODE_STEPS,
        kwargs={"task": Go1Climb},
    )
    mujoco_vector.register("Go1Climb-v0")
    table = Table("simulator", *(f"steps of {100 * height:.0f} cm" for height in HEIGHTS))
    for name, (space, given) in simulators().items():
        cells = []
        for height in HEIGHTS:
            settings = {"terrain": pit(height), "noise": 0.0, "push": 0.0} | given
            found = evaluate(policy, f"{space}/Go1Climb-v0", episodes=episodes, seed=2**32, infos=("climbed",), **settings)
            cells.append(f"{100 * np.mean(found.infos['climbed'] > 0.0):.0f} %")
        table.add(name, *cells)
    return table


def returns(policy: Any, episodes: int) -> Table:
    """Table of returns in `stepper/Go1Rough-v0`, with a row for each simulator.

    Robots start in all rows of the task's terrain grid. The rows differ in difficulty.
    """
    mujoco_vector.register("Go1Rough-v0")
    table = Table("simulator", "mean return", "95 % confidence", "velocity error, m/s", "ended early")
    weights = policy.environment.get("rewards")
    for name, (space, given) in simulators().items():
        settings = {"rewards": weights, "max_init_level": ROUGH.num_rows - 1} | given
        found = evaluate(policy, f"{space}/Go1Rough-v0", episodes=episodes, seed=2**32, infos=("tracking_error",), **settings)
        low, high = found.interval()
        early = f"{np.sum(found.lengths < EPISODE_STEPS)} of {episodes}"
        table.add(name, f"{found.mean:.1f}", f"{low:.1f} to {high:.1f}", f"{found.infos['tracking_error'].mean():.3f}", early)
    return table


def main() -> None:
    """Evaluate a policy and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=Path, help="file of the policy")
    parser.add_argument("--episodes", type=int, default=200, help="number of episodes per cell [200]")
    parser.add_argument("--update-docs", action="store_true", help="replace the tables in docs/benchmarks/training.md")
    given = parser.parse_args()
    policy = load(given.policy)
    for name, table in (("climbs", climbs), ("rough returns", returns)):
        text = str(table(policy, given.episodes))
        print()
        if given.update_docs:
            write_section(PAGE, name, text)


if __name__ == "__main__":
    main()
