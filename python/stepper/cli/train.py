"""`stepper train`."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

from stepper.policies.ppo_settings import arguments

if TYPE_CHECKING:
    from typer import Typer


def train(words: list[str]) -> None:
    """Trains a policy by proximal policy optimisation (PPO) in PyTorch, evaluates it, and films it.

    Every setting of the learner is an option too: --help lists them. A stopped run continues with the same command.
    To change the learner, write a copy of it with --copy, and train with that file.

    Example: stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

    Example: stepper train my_task:me/Push-v0 --steps 3000000 --num-envs 512

    Example: stepper train --copy my_ppo.py
    """
    arguments("stepper train").parse_args(words)  # Help and wrong options need no PyTorch, which takes seconds to import.
    print("stepper train: importing PyTorch", flush=True)
    from stepper.policies.ppo import main  # noqa: PLC0415

    main(words, "stepper train")


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command. The learner reads its arguments itself, so that a copy of it has the same ones."""
    text = "The environment, stepper/HalfCheetah-v5 by default, and options of the learner, which --help lists."
    words = typer.Argument(None, metavar="[ENV] [OPTIONS]", help=text)

    @app.command("train", help=train.__doc__, context_settings={"ignore_unknown_options": True}, add_help_option=False)
    def _(arguments: list[str] | None = words) -> None:
        train(arguments or [])
