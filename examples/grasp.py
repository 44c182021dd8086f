"""Gripper that learns to lift a box with little force, by derivatives of the simulation and by PPO.

    python examples/grasp.py    # both learners with three seeds, as a table; 90 s of processor time

A hand with two fingers, driven by forces, stands around a box at a random place between the fingers. The reward is for the box 10 cm above
its start, less a cost of the finger forces. Friction holds the box if each finger presses with at least m g / (2 mu) = 6.5 N.

The learner by derivatives is that of shac.py, with a whole episode as its horizon. The other learner is the PPO of `stepper train`. Both
have the same networks, initial weights and task. The task is python/stepper/envs/basic/grasp.py.
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
    """Evaluation of a policy on episodes that are not used in training.

    Attributes:
        rollouts: Number of training episodes until now.
        processor: Processor time of the training until now, s.
        gain: Mean return.
        miss: Root mean square of the error of the box's final height, m.
        force: Mean force of a finger at the end, N.
    """

    rollouts: int
    processor: float
    gain: float
    miss: float
    force: float


def score(policy: Policy, rollouts: int, processor: float) -> Score:
    """Evaluates a policy in 32 episodes whose seeds the training does not use.

    Args:
        policy: The policy.
        rollouts: Number of training episodes until now.
        processor: Processor time of the training until now, s.
    """
    envs: Any = gymnasium.make_vec(NAME, num_envs=32)
    observation, _ = envs.reset(seed=ppo.EVALUATION_SEED)
    gain = 0.0
    for _ in range(ACTIONS):
        action = policy(observation)
        observation, reward, *_, info = envs.step(action)
        gain += float(reward.mean())
    return Score(rollouts, processor, gain, float(np.sqrt(np.mean((info["rise"] - RISE) ** 2))), float(FORCE * action[:, 1:].mean()))


def grip(net: ppo.ActorCritic) -> None:
    """Set the initial action of a policy to a grip that lifts the box too fast.

    While the box lies on the floor, the derivative of its height with respect to the actions is zero. Without this grip, learning could not
    begin.
    """
    with torch.no_grad():
        net.actor[-1].bias[:] = torch.tensor([0.4, 0.5, 0.5])


def by_derivatives(rollouts: int, seed: int = 1, **given: Any) -> Iterator[Score]:
    """Learns with gradients through whole episodes, and yields a score before learning and after every update.

    Args:
        rollouts: Number of training episodes.
        seed: Seed of all random numbers.
        **given: Hyperparameters, as in `Plan`.
    """
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
    """Learns with PPO, and yields a score after every update.

    Args:
        rollouts: Number of training episodes.
        seed: Seed of all random numbers.
        **given: Settings of the learner, as in `stepper.policies.ppo_settings.Settings`.
    """
    own = {"num_envs": 64, "horizon": ACTIONS, "minibatch": 640, "epochs": 8, "initial_std": Plan.std, "threads": 1}
    run, spent = ppo.Run(Settings(env=NAME, seed=seed, **{**own, **given})), 0.0
    grip(run.net)
    while run.episodes < rollouts:
        spent -= time.process_time()
        run.update(run.collect())
        spent += time.process_time()
        yield score(run.policy(), run.episodes, spent)


LEARNERS = {"derivatives": (by_derivatives, 320), "PPO": (by_ppo, 1600)}
"""Function of each learner, and its number of training episodes, by name of the learner."""
MARKS = (30.0, 35.0)
"""Returns for the table, which shows after how many training episodes, and after what time, a learner first reaches each of them."""


def row(name: str, seed: int, scores: list[Score]) -> str:
    """Row of a Markdown table with the result of one training run.

    For each return in `MARKS` it has the numbers of training episodes and the processor time after which the policy reaches this return.
    Then follows the final score.

    Args:
        name: Name of the learner.
        seed: Seed of the run.
        scores: Scores in the order of training.
    """
    cells = [name, str(seed)]
    for mark in MARKS:
        first = next((s for s in scores if s.gain >= mark), None)
        cells += [str(first.rollouts), f"{first.processor:.1f}"] if first else ["never", ""]
    last = scores[-1]
    cells += [str(last.rollouts), f"{last.processor:.1f}", f"{last.gain:.1f}", f"{1e3 * last.miss:.1f} mm", f"{last.force:.1f} N"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Run the learner by derivatives and the learner by PPO, and print a table of their scores."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each learner [3]")
    given = parser.parse_args()
    torch.set_num_threads(1)
    marks = "".join(f" rollouts until return {mark:.0f} | processor s |" for mark in MARKS)
    print(f"| learner | seed |{marks} rollouts in all | processor s | final return | height error (rms) | force of a finger |")
    print("|" + "---|" * (7 + 2 * len(MARKS)))
    for name, (learn, rollouts) in LEARNERS.items():
        for seed in range(1, given.seeds + 1):
            print(row(name, seed, list(learn(rollouts, seed))), flush=True)


if __name__ == "__main__":
    main()
