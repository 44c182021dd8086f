"""`stepper chart`."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT
from stepper.experiments.chart import SCENES, Effort, charts
from stepper.experiments.progress import progress, show_files

if TYPE_CHECKING:
    from typer import Typer


def chart(scene: str, out: Path, *, quick: bool) -> None:
    """Speed against accuracy: sweeps time steps and settings of stepper and of MuJoCo over a scene whose right answer is known."""
    names = list(SCENES)
    if scene not in (*names, "all"):
        raise ValueError(f'there is no scene "{scene}", there are: {", ".join(names)}, all')
    effort = Effort.quick() if quick else Effort()
    with progress() as tick:
        pictures = charts(names if scene == "all" else [scene], out, effort, tick)
    show_files([file for picture in pictures for file in (picture, picture.with_suffix(".csv"))])


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    folder = typer.Option("out", "--out", help=OUT)

    @app.command("chart", help=chart.__doc__)
    def _(
        scene: str = typer.Argument("all", help="chain, box or all."),
        out: Path = folder,
        quick: bool = typer.Option(False, "--quick", help="Fewer repeats and time steps."),
    ) -> None:
        chart(scene, out, quick=quick)
