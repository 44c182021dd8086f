"""Command `stepper demo`: a thousand humanoids that fall and come to rest, in stepper and in MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out
from stepper.lab.demo import Plan
from stepper.lab.demo import demo as run


def demo(
    num_envs: Annotated[int, typer.Option(min=1, help="Number of humanoids.")] = 1024,
    steps: Annotated[int, typer.Option(min=1, help="Number of steps with random controls.")] = 500,
    rest: Annotated[int, typer.Option(min=0, help="Number of steps without controls after them.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random controls.")] = 0,
    out: Out = Path("out"),
) -> None:
    """Compares stepper with MuJoCo on a thousand humanoids that fall and come to rest: speed and errors."""
    run(Plan(num_envs=num_envs, steps=steps, rest=rest, seed=seed), out)
