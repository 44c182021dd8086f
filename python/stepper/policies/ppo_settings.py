"""Settings of the learner (`stepper.policies.ppo`), their defaults for each task, and the command line. It does not import PyTorch."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepper.policies.evaluation import is_native

ABOUT = """Trains a task by proximal policy optimisation (PPO), keeps its learning curve, checkpoint and policy, evaluates and films it.

    stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

A stopped run continues with the same command. Settings of a task are those in stepper/policies/ppo_settings.py; options replace them."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a training run. The same settings give the same learning curve.

    Attributes:
        env: Id of an environment in Gymnasium's registry.
        seed: Seed of all random numbers.
        steps: Number of environment steps.
        contact: Law of contact of stepper's environments, "mujoco" or "hard"; empty is the task's default.
        precision: Scalar type of the steps of stepper's environments.
        num_envs: Number of environments that step together.
        horizon: Steps of each environment between two updates.
        epochs: Passes over the samples of an update.
        minibatch: Samples per gradient step; samples that do not fill a minibatch are skipped.
        hidden: Units of each of the two hidden layers.
        learning_rate: Initial learning rate of Adam.
        target_kl: Target Kullback-Leibler divergence of an update, nats; above twice it the learning rate falls, below half it rises.
        gamma: Discount.
        gae_lambda: Decay factor of the advantage estimator.
        clip: Largest change of the probability ratio.
        entropy: Weight of the entropy bonus.
        value: Weight of the value loss.
        max_grad_norm: Bound of the gradient's norm.
        initial_std: Initial standard deviation of the actions, as a share of half their range.
        threads: Threads of the physics and of the learner.

    Raises:
        ValueError: There are fewer samples between two updates than a minibatch has.
    """

    env: str = "stepper/HalfCheetah-v5"
    seed: int = 1
    steps: int = 10_000_000
    contact: str = ""
    precision: str = "f32"
    num_envs: int = 1024
    horizon: int = 32
    epochs: int = 4
    minibatch: int = 8192
    hidden: int = 64
    learning_rate: float = 1e-3
    target_kl: float = 0.015
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    value: float = 1.0
    max_grad_norm: float = 1.0
    initial_std: float = 0.6
    threads: int = 2

    def __post_init__(self) -> None:
        samples = self.num_envs * self.horizon
        if not 1 <= self.minibatch <= samples:
            raise ValueError(
                f"minibatch is {self.minibatch}, must be from 1 to the {samples} samples between two updates "
                f"({self.num_envs} environments, {self.horizon} steps of each), or nothing is learned: give a smaller --minibatch"
            )

    @classmethod
    def of_task(cls, env: str, **given: Any) -> Settings:
        """Settings of a task in `TASKS`, with the changes of `given`."""
        return cls(env=env, **{**TASKS.get(env.rpartition("/")[2], {}), **given})

    def environment(self) -> dict[str, Any]:
        """Arguments of the environment: contact and precision, for environments on stepper."""
        given = {"contact": self.contact, "precision": self.precision} if is_native(self.env) else {}
        return {name: value for name, value in given.items() if value}


SMALL: Mapping[str, Any] = {
    "steps": 3_000_000,
    "num_envs": 64,
    "horizon": 64,
    "minibatch": 512,
    "epochs": 8,
    "learning_rate": 3e-4,
    "target_kl": 0.01,
    "max_grad_norm": 0.5,
    "initial_std": 1.0,
}
"""Settings with many small gradient steps and a large initial spread of actions, for tasks whose episodes end with a fall."""

ROUGH: Mapping[str, Any] = {
    "steps": 100_000_000,
    "horizon": 24,
    "minibatch": 6144,
    "epochs": 5,
    "hidden": 256,
    "entropy": 0.005,
    "initial_std": 0.5,
}
"""Settings of mjlab's rough velocity tasks, with smaller networks."""


TASKS: Mapping[str, Mapping[str, Any]] = {
    "Hopper-v5": SMALL,
    "Walker2d-v5": SMALL,
    "Ant-v5": {**SMALL, "steps": 10_000_000, "initial_std": 0.5},
    "Humanoid-v5": {**SMALL, "initial_std": 0.5},
    "HumanoidStandup-v5": {"steps": 3_000_000},
    "Pusher-v5": {"steps": 5_000_000},
    "Reacher-v5": {**SMALL, "steps": 2_000_000, "initial_std": 0.5},
    "Swimmer-v5": {**SMALL, "gamma": 0.9995},
    "InvertedPendulum-v5": {"steps": 2_000_000},
    "InvertedDoublePendulum-v5": {"steps": 3_000_000},
    "Go1Velocity-v0": {"steps": 13_000_000, "epochs": 5},
    "Go1VelocityReal-v0": {"steps": 13_000_000, "epochs": 5},
    "Go1Rough-v0": ROUGH,
    "G1Rough-v0": {**ROUGH, "steps": 200_000_000},
    "G1Velocity-v0": {"steps": 40_000_000, "epochs": 5, "contact": "mujoco", "hidden": 128, "initial_std": 0.5},
}
"""Settings of tasks that differ from the defaults of `Settings`, for any simulator. Options of the command line override both."""


def copy_learner(source: Path, file: Path) -> None:
    """Copies the file of a learner.

    Args:
        source: File of the learner.
        file: Path of the copy.

    Raises:
        ValueError: The copy exists already.
    """
    if file.exists():
        raise ValueError(f"--copy: {file} exists; name a new file, or remove it")
    file.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    print(f"wrote {file}; change it, and train with: python {file} {Settings.env}")


def arguments(prog: str | None = None) -> argparse.ArgumentParser:
    """Parser of the command line: every setting is an option, with its description in `Settings` as help."""
    parser = argparse.ArgumentParser(prog=prog, description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "env", nargs="?", default=Settings.env, help=f"an id in Gymnasium's registry, or module:id; {Settings.env} by default"
    )
    parser.add_argument("--out", type=Path, help="folder of the run; a folder in out/train by default")
    parser.add_argument("--evaluate", type=int, default=20, metavar="EPISODES", help="number of evaluation episodes after the training")
    parser.add_argument("--film", type=Path, metavar="FILE", help="video (mp4) of one more episode")
    parser.add_argument("--copy", type=Path, metavar="FILE", help="copy the learner's source to a new file, for changes, and exit")
    # Python 3.13 removes the indentation of docstrings; earlier versions keep it.
    texts = dict(re.findall(r"^    (\w+): (.*)$", inspect.cleandoc(str(Settings.__doc__)), re.MULTILINE))
    for field in dataclasses.fields(Settings):
        if field.name != "env":
            flag, text = f"--{field.name.replace('_', '-')}", f"{texts[field.name]} [{field.default}]"
            parser.add_argument(flag, type=type(field.default), help=text)
    return parser
