"""Command `stepper sweep`: variation of each parameter of a study over its range."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import ONLY, OUT, RAY, SEED, STUDY, VALUES, progress_kept_in, study_of_file, values_of
from stepper.lab.progress import show_files
from stepper.lab.study import sweep as run

if TYPE_CHECKING:
    from typer import Typer


def sweep(
    study: Path,
    out: Path,
    *,
    parameters: list[str],
    cliffs: bool,
    resolution: float,
    ray: bool,
    seed: int | None,
    values: Sequence[str] = (),
) -> None:
    """Varies the parameters of a study over their ranges, one parameter at a time, and prints success rates and cliffs.

    Success rates have Wilson confidence intervals. A cliff is a parameter value at which episodes change from success to failure; bisection
    locates it. With --parameter, the command varies only the named parameters. --values sets nominal values of other parameters. The same
    command continues a stopped run after the last stored result.

    Example: stepper sweep examples/studies/tray.toml

    Example: stepper sweep examples/studies/tray.toml --parameter friction --parameter 'body_mass[object]=0.2..0.5'

    Example: stepper sweep examples/studies/tray.toml --parameter friction --values push=1.5 --values 'gravity[2]=-3.7'
    """
    own = study_of_file(study, ray=ray, seed=seed)
    # A selector of --values becomes a parameter of the study, which the sweep does not vary.
    names = parameters or (list(own.parameters) if values else None)
    with progress_kept_in(out) as progress:
        found = run(own.at(values_of(values)), out, parameters=names, cliffs=cliffs, resolution=resolution, progress=progress)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `sweep` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    study_file = typer.Argument(help=STUDY)
    on_ray = typer.Option(False, "--ray", help=RAY)
    names = typer.Option([], "--parameter", help=ONLY)
    nominal = typer.Option([], "--values", help=VALUES)

    @app.command("sweep", help=sweep.__doc__)
    def _(
        study: Path = study_file,
        out: Path = folder,
        *,
        parameter: list[str] = names,
        values: list[str] = nominal,
        cliffs: bool = typer.Option(True, help="Locate cliffs, the values at which episodes change from success to failure."),
        resolution: float = typer.Option(
            1e-3, min=1e-12, max=0.5, help="Precision of a cliff's value, as a fraction of the parameter's range."
        ),
        seed: int | None = typer.Option(None, min=0, help=SEED),
        ray: bool = on_ray,
    ) -> None:
        sweep(study, out, parameters=parameter, cliffs=cliffs, resolution=resolution, ray=ray, seed=seed, values=values)
