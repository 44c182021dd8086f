"""Command `stepper tune`: cheapest settings within an error budget."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT, RAY_RUNS, VALUES, source_with
from stepper.lab.accuracy import tune as run
from stepper.lab.progress import show_files, show_progress

if TYPE_CHECKING:
    from typer import Typer


def tune(
    source: str,
    out: Path,
    *,
    error: str,
    horizon: str,
    coverage: float,
    alone: bool,
    reduce: bool,
    ray: bool,
    values: Sequence[str] = (),
) -> None:
    """Finds the cheapest settings within an error budget, tests them on further episodes, and prints them as Options(...).

    The command also lists parts of the scene that can be removed within the budget.

    Example: stepper tune robot.xml --error "1 mm" --horizon "0.5 s"
    """
    with show_progress() as progress:
        chosen = source_with(source, ray=ray, values=values)
        found = run(chosen, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, progress=progress)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `tune` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    on_ray = typer.Option(False, "--ray", help=RAY_RUNS)
    chosen = typer.Option([], "--values", help=VALUES)

    @app.command("tune", help=tune.__doc__)
    def _(
        source: str = typer.Argument(help="Model (MJCF, URDF, saved) or study (.toml, .py)."),
        *,
        error: str = typer.Option(..., help='Error budget: "1 mm", "0.5 deg".'),
        horizon: str = typer.Option(..., help='Simulated time up to which the error must stay within the budget: "1 s".'),
        out: Path = folder,
        coverage: float = typer.Option(0.9, help="Fraction of episodes that must stay within the budget, with 95 % confidence."),
        alone: bool = typer.Option(False, "--alone", help="Minimise the cost of a single environment, not of a batch."),
        reduce: bool = typer.Option(True, help="Search for parts of the scene that can be removed."),
        values: list[str] = chosen,
        ray: bool = on_ray,
    ) -> None:
        tune(source, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, ray=ray, values=values)
