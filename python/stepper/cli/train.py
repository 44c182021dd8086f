"""Command `stepper train`: training of a policy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.policies import ppo_settings


def train(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ENV] [OPTIONS]", help="Environment, stepper/HalfCheetah-v5 by default, and options of the learner; --help lists them."
        ),
    ] = None,
) -> None:
    """Trains a policy by proximal policy optimisation (PPO) in PyTorch, evaluates it, and films it with --film.

    Every setting of the learner is an option; --help lists them. --values NAME=VALUE sets an argument of the environment, such as a field
    of its task. Files are written to a folder of out/train in the working folder, or to --out. The same command continues a stopped run.
    To change the learner, copy its source with --copy, change the copy, and run that.

    Example: stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

    Example: stepper train my_task:me/Push-v0 --steps 3000000 --num-envs 512

    Example: stepper train stepper/Go1Velocity-v0 --values roughness=0.05

    Example: stepper train --copy my_ppo.py
    """
    # The learner parses all arguments, so that a copy of it has the same options.
    words = arguments or []
    # Help, wrong options and --copy work without PyTorch, which takes seconds to import.
    given = ppo_settings.arguments("stepper train").parse_args(words)
    if given.copy is not None:
        ppo_settings.copy_learner(Path(ppo_settings.__file__).with_name("ppo.py"), given.copy)
        return
    print("stepper train: importing PyTorch", flush=True)
    from stepper.policies.ppo import main  # noqa: PLC0415

    main(words, "stepper train")
