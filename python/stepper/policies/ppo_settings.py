"""Settings of the learner (`stepper.policies.ppo`) with defaults for each task, and its command line. PyTorch is not imported."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stepper.policies.evaluation import is_native
from stepper.policies.policy import ACTIVATIONS
from stepper.shared.arguments import argument_values, check_file_name, check_number, check_whole
from stepper.shared.files import read_text, write_text

ABOUT = """Trains a policy for a task by proximal policy optimisation (PPO), evaluates it, and films it with --film.

The command writes the learning curve, a checkpoint and the policy to a new folder in out/train, or to the folder of --out.

    stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4
    stepper train stepper/Go1Velocity-v0 --values roughness=0.05

The same command continues a stopped run. Each task has its settings in stepper/policies/ppo_settings.py; options override these."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a training run. Equal settings give the same learning curve.

    Attributes:
        env: Id of an environment in Gymnasium's registry.
        seed: Seed of all random numbers.
        steps: Number of environment steps, summed over all environments.
        contact: Contact law of environments that stepper simulates, "mujoco" or "hard"; an empty text selects the default of the task.
        precision: Precision of environments that stepper simulates, "f64" or "f32".
        num_envs: Number of environments that step in parallel.
        horizon: Number of steps of each environment between two updates.
        epochs: Number of passes over the samples of an update.
        minibatch: Number of samples per gradient step; samples that do not fill a minibatch are skipped.
        hidden: Number of units in each hidden layer, as 512,256,128.
        activation: Activation function of the hidden layers: tanh, elu or relu.
        learning_rate: Initial learning rate of Adam.
        target_kl: Target Kullback-Leibler divergence of an update, nats. The learning rate falls above 2 x target, and rises below half.
        gamma: Discount factor per action.
        gae_lambda: Decay factor lambda of generalised advantage estimation.
        clip: Deviation of the probability ratio from 1 at which the objective is clipped.
        entropy: Weight of the entropy bonus.
        value: Weight of the loss of the critic.
        max_grad_norm: Largest norm of the gradient; larger gradients are scaled down.
        initial_std: Initial standard deviation of the actions, as a fraction of half their range.
        action_std: Initial standard deviation of the actions in their unit, in place of initial_std; 0 selects initial_std.
        min_std: Least divisor of observed numbers. A number with the standard deviation std is divided by sqrt(std^2 + min_std^2).
            Numbers that hardly vary, such as heights of flat ground, then stay small.
        threads: Number of threads of the physics and of the learner.
        values: Arguments of the environment by name, such as fields of its task, roughness=0.1, or weights of terms of the reward,
            rewards.pose=0.5. Repeat the option for more.

    Raises:
        ValueError: A minibatch has more samples than there are between two updates. Or a deviation is negative or not finite, a layer has
            no units, or the activation function is unknown.
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
    hidden: Sequence[int] = (64, 64)
    activation: str = "tanh"
    learning_rate: float = 1e-3
    target_kl: float = 0.015
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    value: float = 1.0
    max_grad_norm: float = 1.0
    initial_std: float = 0.6
    action_std: float = 0.0
    min_std: float = 1e-4
    threads: int = 2
    values: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("min_std", "action_std"):
            check_number(name, getattr(self, name), least=0.0)
        object.__setattr__(self, "hidden", tuple(self.hidden))
        for units in self.hidden:
            check_whole("a number of hidden units", units, least=1)
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation is {self.activation!r}, must be one of {', '.join(ACTIVATIONS)}")
        samples = self.num_envs * self.horizon
        if not 1 <= self.minibatch <= samples:
            raise ValueError(
                f"minibatch is {self.minibatch}, must be from 1 to the {samples} samples between two updates "
                f"({self.num_envs} environments, {self.horizon} steps of each), or nothing is learned: give a smaller --minibatch"
            )

    @classmethod
    def of_task(cls, env: str, **given: Any) -> Settings:
        """Settings for the environment with the id `env`: the settings of its task in `TASKS`, overridden by the arguments `given`."""
        return cls(env=env, **{**TASKS.get(env.rpartition("/")[2], {}), **given})

    def environment(self) -> dict[str, Any]:
        """Arguments for the creation of the environment: `values`; for an environment that stepper simulates also contact and precision."""
        given = {"contact": self.contact, "precision": self.precision} if is_native(self.env) else {}
        return {name: value for name, value in given.items() if value} | dict(self.values)


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
"""Settings with many small gradient steps and a large initial standard deviation of the actions, for tasks that end with a fall."""

ROUGH: Mapping[str, Any] = {
    "steps": 100_000_000,
    "horizon": 24,
    "minibatch": 6144,
    "epochs": 5,
    "hidden": (256, 256),
    "entropy": 0.005,
    "initial_std": 0.25,
    "min_std": 0.05,
}
"""Settings of mjlab for its velocity tasks on rough terrain, with smaller networks.

Without `min_std`, the 187 nearly equal heights of a scan of flat ground dominate the first layer, and the robot learns to stand still."""


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
    "G1Velocity-v0": {"steps": 40_000_000, "epochs": 5, "contact": "mujoco", "hidden": (128, 128), "initial_std": 0.5},
}
"""Settings of each task that differ from the defaults of `Settings`, by id without the namespace, for any simulator.

Options of the command line override them."""


CHECKPOINT = "checkpoint.pt"
"""Name of the file in the folder of a run from which the same command continues the run."""


def default_folder(settings: Settings) -> Path:
    """Folder of a run without the option --out: out/train, task with its arguments, and seed.

    Raises:
        ValueError: The arguments of the task cannot be part of the name of a folder.
    """
    chosen = [settings.contact] * bool(settings.contact)
    for argument, value in settings.values.items():
        values = {f"{argument}.{key}": inner for key, inner in value.items()} if isinstance(value, Mapping) else {argument: value}
        chosen += [f"{key}={inner}" for key, inner in values.items()]
    name = "_".join([settings.env, *chosen]).replace("/", "_")
    check_file_name("the task with its --values", name, "the folder of the run, unless --out does")
    return Path("out/train", name, f"seed{settings.seed}")


@contextlib.contextmanager
def kept_at_interrupt(checkpoint: Path) -> Iterator[None]:
    """Context manager that prints after Ctrl-C whether the checkpoint of a run exists, and how to continue the run."""
    try:
        yield
    except KeyboardInterrupt:
        kept = f"the run up to its last checkpoint is in {checkpoint.parent}; the same command continues it"
        nothing = f"the first update was not finished, so nothing is kept in {checkpoint.parent}"
        print(f"\nstopped: {kept if checkpoint.exists() else nothing}", file=sys.stderr, flush=True)
        raise


def check_bounds(env: str, space: Any) -> None:
    """Raises ValueError if a space of actions has an infinite bound, because the learner's actions are fractions of half the range."""
    if unbounded := np.flatnonzero(~np.isfinite(space.low) | ~np.isfinite(space.high)).tolist():
        k = unbounded[0]
        more = f", and {len(unbounded) - 1} more actions have infinite bounds" if len(unbounded) > 1 else ""
        raise ValueError(
            f"action {k} of {env} has the bounds {space.low[k]} to {space.high[k]}{more}; the learner explores in fractions of half the "
            "range: define finite bounds in the task by action_bounds(self, model), or in the model's file by ctrlrange of the actuators"
        )


def copy_learner(source: Path, file: Path) -> None:
    """Copies the source file of the learner, and prints how to run the copy (option --copy)."""
    if file.exists():
        raise ValueError(f"--copy: {file} exists; name a new file, or remove it")
    write_text(file, read_text(source, "Python"))
    print(f"wrote {file}; change it, and train with: python {file} {Settings.env}")


def arguments(prog: str | None = None) -> argparse.ArgumentParser:
    """Parser of the command line. Every setting is an option; its help text is the description in `Settings`."""
    parser = argparse.ArgumentParser(prog=prog, description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env", nargs="?", default=Settings.env, help=f"id in Gymnasium's registry, or module:id [{Settings.env}]")
    parser.add_argument("--out", type=Path, help="folder of the run [a folder in out/train]")
    parser.add_argument("--evaluate", type=int, default=20, metavar="EPISODES", help="number of evaluation episodes after the training")
    parser.add_argument("--film", type=Path, metavar="FILE", help="video (mp4) of one more episode")
    parser.add_argument("--copy", type=Path, metavar="FILE", help="copy the learner's source to a new file, for changes, and exit")
    # Python 3.13 removes the indentation of docstrings; earlier versions keep it.
    texts = dict(re.findall(r"^    (\w+): (.*)$", inspect.cleandoc(str(Settings.__doc__)), re.MULTILINE))
    for setting in dataclasses.fields(Settings):
        if setting.name not in ("env", "values"):
            default = ",".join(map(str, setting.default)) if isinstance(setting.default, tuple) else setting.default
            flag, text = f"--{setting.name.replace('_', '-')}", f"{texts[setting.name]} [{default}]"
            parser.add_argument(flag, type=_units if setting.name == "hidden" else type(setting.default), help=text)
    parser.add_argument("--values", action="append", metavar="NAME=VALUE", help=texts["values"])
    return parser


def _units(text: str) -> tuple[int, ...]:
    """Numbers of hidden units from a text such as "512,256,128"; a ValueError for another text."""
    return tuple(int(number) for number in text.split(","))


def settings_of(env: str, given: Mapping[str, Any]) -> Settings:
    """Settings for an environment from options of the command line by name; options that are None have their defaults."""
    options = {name: value for name, value in given.items() if value is not None}
    if "values" in options:
        options["values"] = argument_values(options["values"], "--values")
        if own := sorted(options["values"].keys() & {"contact", "precision", "threads", "num_envs"}):
            raise ValueError(f"--values sets {own[0]}: use the option --{own[0].replace('_', '-')} instead")
    return Settings.of_task(env, **options)
