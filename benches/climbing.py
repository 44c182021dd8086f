"""Evaluation of a policy of `stepper/Go1Rough-v0` in several simulators: climbing of stairs, and returns in the task.

    python examples/train_stairs.py
    python benches/climbing.py out/train/stairs/stage3/policy.npz

The script prints three tables. The first compares contacts on stairs with MuJoCo's. The second has the fraction of episodes in which the
robot climbs five steps out of a pit in 20 s. The robot starts at a random heading, and is commanded to turn to the x axis and to walk along
it. The third table has returns in the task itself, with all its randomisation and the reward weights of the policy's training. Episodes
end early after a fall, or when the robot leaves the terrain.
"""

import argparse
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import mujoco_vector
import numpy as np
from sections import write_section
from stepper import Options
from stepper.envs import StepperVectorEnv
from stepper.envs.commands import VelocityCommand
from stepper.envs.locomotion import Go1Rough
from stepper.envs.locomotion.velocity import ROUGH
from stepper.envs.task import Array, TaskView, Terms
from stepper.envs.terrain import PyramidStairs, Terrain
from stepper.loading import origin_of
from stepper.policies import Evaluation, evaluate, load

PAGE = Path(__file__).parents[1] / "docs/benchmarks/training.md"
HEIGHTS = (0.05, 0.1, 0.15, 0.2)
"""Heights of the steps, m."""
STEEP = 0.4
"""Vertical component of a contact normal below which the contact is at no face of stairs of 15 cm."""
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


def climbs(policy: Any, episodes: int) -> Iterator[str]:
    """Lines of a Markdown table of climbing: the fraction of episodes in which the robot leaves the pit.

    Rows are simulators, and columns heights of a step.
    """
    gymnasium.register(
        "stepper/Go1Climb-v0",
        vector_entry_point="stepper.envs:StepperVectorEnv",
        max_episode_steps=EPISODE_STEPS,
        kwargs={"task": Go1Climb},
    )
    mujoco_vector.register("Go1Climb-v0")
    yield "| simulator | " + " | ".join(f"steps of {100 * height:.0f} cm" for height in HEIGHTS) + " |"
    yield "|---" * (1 + len(HEIGHTS)) + "|"
    for name, (space, given) in simulators().items():
        cells = []
        for height in HEIGHTS:
            found = evaluate(
                policy,
                f"{space}/Go1Climb-v0",
                episodes=episodes,
                seed=2**32,
                infos=("climbed",),
                terrain=pit(height),
                noise=0.0,
                push=0.0,
                **given,
            )
            cells.append(f"{100 * np.mean(found.infos['climbed'] > 0.0):.0f} %")
        yield f"| {name} | " + " | ".join(cells) + " |"


def returns(policy: Any, episodes: int) -> Iterator[str]:
    """Lines of a Markdown table of returns in `stepper/Go1Rough-v0`, with a row for each simulator.

    Robots start in all rows of the task's terrain grid. The rows differ in difficulty.
    """
    mujoco_vector.register("Go1Rough-v0")
    yield "| simulator | mean return | 95 % confidence | velocity error, m/s | ended early |"
    yield "|---" * 5 + "|"
    weights = policy.environment.get("rewards")
    levels = {"max_init_level": ROUGH.num_rows - 1}
    for name, (space, given) in simulators().items():
        found: Evaluation = evaluate(
            policy,
            f"{space}/Go1Rough-v0",
            episodes=episodes,
            seed=2**32,
            infos=("tracking_error",),
            rewards=weights,
            **levels,
            **given,
        )
        low, high = found.interval()
        early = f"{np.sum(found.lengths < EPISODE_STEPS)} of {episodes}"
        error = found.infos["tracking_error"].mean()
        yield f"| {name} | {found.mean:.1f} | {low:.1f} to {high:.1f} | {error:.3f} | {early} |"


def contact_normals(policy: Any, episodes: int) -> Iterator[str]:
    """Lines of a Markdown table that compares contacts on stairs of 15 cm with those that MuJoCo finds in the same states.

    The steepest faces of these stairs are ramps of 15 cm over 10 cm, whose normals have a vertical component of 0.55. Contacts
    with a smaller component than `STEEP` are at no face.
    """
    task = Go1Climb(terrain=pit(0.15), noise=0.0, push=0.0)
    envs = StepperVectorEnv(task, min(episodes, 16), max_episode_steps=EPISODE_STEPS, autoreset_mode="SameStep", contact="mujoco")
    origin = origin_of(task.model())
    assert origin is not None
    model = mujoco.MjModel.from_xml_string(origin.source)
    data = mujoco.MjData(model)
    observation, _ = envs.reset(seed=1)
    found: dict[str, list[float]] = {"MuJoCo's law": [], "MuJoCo": []}
    for step in range(260):
        observation, *_ = envs.step(policy(observation))
        if step < 60 or step % 20:  # At first the robots are on the bottom of the pit.
            continue
        found["MuJoCo's law"].extend(np.abs(envs.sim.contacts()["normal"][:, 2]))
        for env in range(envs.num_envs):
            data.qpos[:], data.qvel[:] = envs.sim.qpos[env], envs.sim.qvel[env]
            mujoco.mj_forward(model, data)
            found["MuJoCo"].extend(np.abs(data.contact.frame[:, 2]))
    yield "| engine | contacts | at no face |"
    yield "|---" * 3 + "|"
    for name, vertical in found.items():
        yield f"| {name} | {len(vertical)} | {np.sum(np.array(vertical) < STEEP)} |"


def main() -> None:
    """Evaluate a policy and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=Path, help="file of the policy")
    parser.add_argument("--episodes", type=int, default=200, help="number of episodes per cell [200]")
    parser.add_argument("--update-docs", action="store_true", help="replace the tables in docs/benchmarks/training.md")
    given = parser.parse_args()
    policy = load(given.policy)
    for name, table in (("climb contacts", contact_normals), ("climbs", climbs), ("rough returns", returns)):
        lines = []
        for line in table(policy, given.episodes):
            print(line, flush=True)
            lines.append(line)
        print()
        if given.update_docs:
            write_section(PAGE, name, "\n".join(lines))


if __name__ == "__main__":
    main()
