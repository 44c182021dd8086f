"""Command `stepper compare`: comparison of hard contact, MuJoCo's contact law and MuJoCo on one model."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT
from stepper.lab.comparison import compare as run
from stepper.lab.progress import show_files, show_progress
from stepper.shared.files import locked

if TYPE_CHECKING:
    from typer import Typer


def compare(model: str, out: Path, *, seconds: float, num_envs: int, seed: int) -> None:
    """Compares hard contact, MuJoCo's contact law in stepper, and MuJoCo, on a model with random controls.

    The command prints a table and draws a picture.

    Example: stepper compare humanoid.xml --seconds 3
    """
    with locked(out):
        with show_progress() as progress:
            found = run(model, seconds=seconds, num_envs=num_envs, seed=seed, progress=progress)
        print(found.table())
        show_files([found.draw(out / "compare.png")])


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `compare` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)

    @app.command("compare", help=compare.__doc__)
    def _(
        model: str = typer.Argument(help="MJCF, URDF or a saved model."),
        out: Path = folder,
        seconds: float = typer.Option(2.0, help="Length of an episode, s."),
        num_envs: int = typer.Option(8, min=1, help="Number of episodes."),
        seed: int = typer.Option(0, help="Seed of the random controls."),
    ) -> None:
        compare(model, out, seconds=seconds, num_envs=num_envs, seed=seed)
