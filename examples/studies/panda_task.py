"""Training of the policy of panda_trained.py: picking a cube at a random place within ±4 cm, with friction of 0.4 to 1.2.

    python examples/studies/panda_task.py stepper/PandaPick-v0 --threads 1

The options are those of `stepper train`.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import panda  # type: ignore[import-not-found]  # noqa: E402
import panda_hand as lab  # type: ignore[import-not-found]  # noqa: E402
import stepper  # noqa: E402
from stepper.envs import Observation, Task, at_reset, uniform  # noqa: E402

LENGTH = 80
"""Number of actions in an episode of 4 s."""
SETTINGS = {
    "steps": 400_000,
    "num_envs": 128,
    "horizon": 40,
    "minibatch": 512,
    "epochs": 6,
    "learning_rate": 5e-4,
    "gamma": 0.98,
    "initial_std": 0.6,
}
"""Hyperparameters that replace the defaults of `stepper train`."""


@dataclass(frozen=True, kw_only=True)
class PandaPick(Task):
    """Task of closing the fingers around a cube and lifting it by 15 cm.

    Action (4,): the first three numbers, -1 to 1, move the target of the hand by up to 2 cm along x, y and z. The fingers close if the last
    number is above 0, and open otherwise.

    Attributes:
        frame_skip: Number of simulation steps per action.
        friction: Lowest and highest friction of cube and fingers, drawn at each reset.
    """

    frame_skip: int = 25
    friction: tuple[float, float] = (0.4, 1.2)

    def model(self) -> Any:
        """Model of arm, gripper and cube, from panda_hand.py."""
        with warnings.catch_warnings():
            # The warning is about solref and solimp of the finger pads, which hard contact does not use.
            warnings.simplefilter("ignore", stepper.ModelWarning)
            return stepper.load(lab.scene())

    def action_bounds(self, model: Any) -> Any:
        """Bounds of the actions, (4,) each."""
        return -np.ones(4), np.ones(4)

    def observations(self) -> Any:
        """Observation of the policy, (10,)."""
        return (Observation("seen", func=lambda now: lab.seen(now.sensordata, now.episode_state["target"], now.episode_state["closed"])),)

    def episode_state(self, num_envs: int) -> Any:
        """Target of the hand (num_envs, 3), m, and closing command of the fingers (num_envs,), 0 or 1."""
        return {"target": np.zeros((num_envs, 3)), "closed": np.zeros(num_envs)}

    def reset(self, reset: Any) -> None:
        """Place the fingers above the nominal position and the cube at random within ±4 cm of it."""
        lab.ready(reset.qpos, reset.rng.uniform(-lab.SPREAD, lab.SPREAD, 2))
        reset.episode_state["target"][:] = [*panda.PLACE, panda.HALF + lab.ABOVE]

    def events(self) -> Any:
        """Friction of cube and fingers, one number for all."""
        return (at_reset("geom_friction[cube,hand_finger*][0]", uniform(*self.friction, shared=True)),)

    def advance(self, now: Any) -> None:
        """Move the target by the action, and step while the servos follow it."""
        episode_state = now.episode_state
        episode_state["target"][:] = lab.moved(episode_state["target"], now.action)
        episode_state["closed"][:] = now.action[:, 3] > 0.0
        now.sim.step(lab.controls(episode_state["target"], episode_state["closed"]), self.frame_skip)

    def terminated(self, now: Any) -> Any:
        """Whether the cube is out of reach, (num_envs,)."""
        return np.abs(now.qpos[:, 9:11] - panda.PLACE).max(axis=1) >= 0.15

    def reward(self, now: Any) -> Any:
        """Reward for fingers near the cube, a grasped cube and its height, less a cost of the motion."""
        readings = now.sensordata
        distance = np.linalg.norm(readings[:, 3:6], axis=1)
        height = np.clip((now.qpos[:, 11] - panda.HALF) / panda.RISE, 0.0, 1.0)
        narrow = np.minimum(readings[:, 6], -readings[:, 7])
        held = (now.episode_state["closed"] > 0.0) & (distance < 0.02) & (narrow > 0.8 * panda.HALF) & (narrow < 1.1 * panda.HALF)
        terms = {
            "reach": 0.5 * (1.0 - np.tanh(8.0 * distance)),
            "hold": 0.5 * held,
            "lift": 4.0 * height,
            "effort": -0.02 * np.square(np.clip(now.action[:, :3], -1.0, 1.0)).sum(axis=1),
        }
        return sum(terms.values()), {"height": height * panda.RISE} | {f"reward_{name}": value for name, value in terms.items()}


def register() -> None:
    """Register the task as stepper/PandaPick-v0."""
    gymnasium.register(
        "stepper/PandaPick-v0",
        entry_point="stepper.envs.single:StepperEnv",
        vector_entry_point="stepper.envs.vector:StepperVectorEnv",
        max_episode_steps=LENGTH,
        kwargs={"task": PandaPick},
    )


if __name__ == "__main__":
    from stepper.policies import ppo, ppo_settings

    # The module name must not be __main__, so that checkpoints can be unpickled elsewhere.
    sys.modules["panda_task"] = sys.modules["__main__"]
    PandaPick.__module__ = "panda_task"
    register()
    ppo_settings.TASKS = {**ppo_settings.TASKS, "PandaPick-v0": SETTINGS}
    ppo.main()
