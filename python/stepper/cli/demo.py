"""Command `stepper demo`: a thousand humanoids that fall and come to rest, in stepper and in MuJoCo."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT
from stepper.lab.demo import Plan, demo

if TYPE_CHECKING:
    from typer import Typer


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `demo` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)

    @app.command("demo")
    def _(
        num_envs: int = typer.Option(1024, min=1, help="Number of humanoids."),
        steps: int = typer.Option(500, min=1, help="Number of steps with random controls."),
        rest: int = typer.Option(1000, min=0, help="Number of steps without controls after them."),
        seed: int = typer.Option(0, min=0, help="Seed of the random controls."),
        out: Path = folder,
    ) -> None:
        """Compares stepper with MuJoCo on a thousand humanoids that fall and come to rest: speed and errors."""
        demo(Plan(num_envs=num_envs, steps=steps, rest=rest, seed=seed), out)
