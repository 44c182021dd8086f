"""`stepper tune`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT, RAY_RUNS, VALUES, of_source
from stepper.lab.accuracy import tune as run
from stepper.lab.progress import progress, show_files

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
    """The cheapest settings that keep an error budget, proved on held-out episodes, as Options(...); and what the scene does not need.

    Example: stepper tune robot.xml --error "1 mm" --horizon "0.5 s"
    """
    with progress() as tick:
        chosen = of_source(source, ray=ray, values=values)
        found = run(chosen, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, tick=tick)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    folder = typer.Option("out", "--out", help=OUT)
    over = typer.Option(False, "--ray", help=RAY_RUNS)
    chosen = typer.Option([], "--values", help=VALUES)

    @app.command("tune", help=tune.__doc__)
    def _(
        source: str = typer.Argument(help="A model (MJCF, URDF, saved) or a study (.toml, .py)."),
        *,
        error: str = typer.Option(..., help='The budget: "1 mm", "0.5 deg".'),
        horizon: str = typer.Option(..., help='Time up to which it holds: "1 s".'),
        out: Path = folder,
        coverage: float = typer.Option(0.9, help="Share of episodes that must hold, with 95 % confidence."),
        alone: bool = typer.Option(False, "--alone", help="The cost of one environment alone counts, not that of a batch."),
        reduce: bool = typer.Option(True, help="Look for what the scene does not need."),
        values: list[str] = chosen,
        ray: bool = over,
    ) -> None:
        tune(source, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, ray=ray, values=values)
