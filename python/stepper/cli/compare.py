"""Command `stepper compare`: comparison of hard contact, MuJoCo's contact law and MuJoCo on one model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out
from stepper.lab.comparison import compare as run
from stepper.lab.progress import show_files, show_progress
from stepper.shared.files import locked


def compare(
    model: Annotated[str, typer.Argument(help="MJCF, URDF or a saved model.")],
    out: Out = Path("out"),
    seconds: Annotated[float, typer.Option(help="Length of an episode, s.")] = 2.0,
    num_envs: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 8,
    seed: Annotated[int, typer.Option(help="Seed of the random controls.")] = 0,
) -> None:
    """Compares hard contact, MuJoCo's contact law in stepper, and MuJoCo, on a model with random controls.

    The command prints a table and draws a picture.

    Example: stepper compare humanoid.xml --seconds 3
    """
    with locked(out):
        with show_progress() as progress:
            found = run(model, seconds=seconds, num_envs=num_envs, seed=seed, progress=progress)
        print(found.table())
        show_files([found.draw(out / "compare.png")])
