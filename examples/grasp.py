"""A gripper learns to lift a box as gently as it can: by derivatives of the simulation, and by PPO.

    python examples/grasp.py    # both from three seeds, and what each took: a minute and a half of processor time

Two fingers and a hand, moved by forces, stand beside a box that lies somewhere between them. The box is wanted 10 cm higher, and forces of
the fingers cost. Friction holds the box if each finger presses with m g / (2 mu) at least, 6.5 N. The learner by derivatives is that of
shac.py with a whole episode as its horizon, the other that of `stepper train`; networks, their initial values and the task are the
same. The task is python/stepper/envs/basic/grasp.py.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from shac import Differentiable, Learner, Plan  # type: ignore[import-not-found]
from stepper.envs.basic.grasp import FORCE, STEPS, Grasp
from stepper.policies import Policy, ppo
from stepper.policies.ppo_settings import Settings

Array = NDArray[Any]

RISE, WEIGHT = Grasp.rise, Grasp.weight
ACTIONS = STEPS

TASK = Differentiable(
    observation=lambda qpos, qvel: torch.cat([qpos, qvel], dim=1),
    reward=lambda qpos, after, qvel, action, dt: 1.0 - ((after[:, 4] - RISE) / RISE).square() - WEIGHT * action[:, 1:].square().sum(dim=1),
)

NAME = "stepper/Grasp-v0"


@dataclass(frozen=True)
class Score:
    """What a policy is worth, over fresh episodes.

    Attributes:
        rollouts: Episodes that the learner had made.
        processor: Time of the processor that it had taken, s.
        gain: Mean return.
        miss: Root mean square of the box's distance from where it should be at the end, m.
        force: Mean force of the fingers at the end, N.
    """

    rollouts: int
    processor: float
    gain: float
    miss: float
    force: float


def score(policy: Policy, rollouts: int, processor: float) -> Score:
    """Runs a policy in 32 episodes that no learner has seen."""
    envs: Any = gymnasium.make_vec(NAME, num_envs=32)
    observation, _ = envs.reset(seed=ppo.EVALUATION_SEED)
    gain = 0.0
    for _ in range(ACTIONS):
        action = policy(observation)
        observation, reward, *_, info = envs.step(action)
        gain += float(reward.mean())
    return Score(rollouts, processor, gain, float(np.sqrt(np.mean((info["rise"] - RISE) ** 2))), float(FORCE * action[:, 1:].mean()))


def grip(net: ppo.ActorCritic) -> None:
    """Makes a policy begin with a grip that lifts the box, too fast: of one that lies on the floor, no derivative says how to lift it."""
    with torch.no_grad():
        net.actor[-1].bias[:] = torch.tensor([0.4, 0.5, 0.5])


def by_derivatives(rollouts: int, seed: int = 1, **given: Any) -> Iterator[Score]:
    """Learns with gradients through whole episodes; yields a score before learning and after every update."""
    plan = Plan(**{"num_envs": 8, "horizon": ACTIONS, "rate": 5e-3, "seed": seed, **given})
    envs = gymnasium.make_vec(NAME, num_envs=plan.num_envs, autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED)
    learner, spent = Learner(envs, TASK, plan), 0.0
    grip(learner.net)
    yield score(learner.policy(), 0, 0.0)
    while (made := learner.updates * plan.num_envs) < rollouts:
        learner.slow(made / rollouts)
        spent -= time.process_time()
        learner.update()
        spent += time.process_time()
        yield score(learner.policy(), learner.updates * plan.num_envs, spent)


def by_ppo(rollouts: int, seed: int = 1, **given: Any) -> Iterator[Score]:
    """Learns with PPO; yields a score after every update."""
    own = {"num_envs": 64, "horizon": ACTIONS, "minibatch": 640, "epochs": 8, "initial_std": Plan.std, "threads": 1}
    run, spent = ppo.Run(Settings(env=NAME, seed=seed, **{**own, **given})), 0.0
    grip(run.net)
    while run.episodes < rollouts:
        spent -= time.process_time()
        run.update(run.collect())
        spent += time.process_time()
        yield score(run.policy(), run.episodes, spent)


LEARNERS = {"derivatives": (by_derivatives, 320), "PPO": (by_ppo, 1600)}
"""Learners and their rollouts."""
MARKS = (30.0, 35.0)
"""Returns whose first time is told."""


def row(name: str, seed: int, scores: list[Score]) -> str:
    """A learner's run as a row of a table: when it came to each mark, and what it came to."""
    cells = [name, str(seed)]
    for mark in MARKS:
        first = next((s for s in scores if s.gain >= mark), None)
        cells += [str(first.rollouts), f"{first.processor:.1f}"] if first else ["never", ""]
    last = scores[-1]
    cells += [str(last.rollouts), f"{last.processor:.1f}", f"{last.gain:.1f}", f"{1e3 * last.miss:.1f} mm", f"{last.force:.1f} N"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Learns by both and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each learner [3]")
    given = parser.parse_args()
    torch.set_num_threads(1)
    marks = "".join(f" rollouts to {mark:.0f} | s |" for mark in MARKS)
    print(f"| by | seed |{marks} rollouts | s | return | the box misses by | force of a finger |")
    print("|" + "---|" * (7 + 2 * len(MARKS)))
    for name, (learn, rollouts) in LEARNERS.items():
        for seed in range(1, given.seeds + 1):
            print(row(name, seed, list(learn(rollouts, seed))), flush=True)


if __name__ == "__main__":
    main()
