"""Command `stepper rank`: ranking of a study's parameters by their influence on the outcome."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import ONLY, OUT, RAY, SEED, STUDY, progress_kept_in, study_of_file
from stepper.lab.progress import show_files
from stepper.lab.study import rank as run
from stepper.lab.study.points import USUAL

if TYPE_CHECKING:
    from typer import Typer


def rank(study: Path, out: Path, *, samples: int, parameters: list[str], setting: str, ray: bool, seed: int | None) -> None:
    """Ranks the parameters of a study by their influence on an outcome: Sobol indices with confidence intervals.

    All parameters vary together over their ranges. The same command continues a stopped run after the last stored result.

    Example: stepper rank examples/studies/quadruped.py --samples 128
    """
    with progress_kept_in(out) as progress:
        found = run(
            study_of_file(study, ray=ray, seed=seed),
            out,
            samples=samples,
            parameters=parameters or None,
            setting=setting,
            progress=progress,
        )
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `rank` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    study_file = typer.Argument(help=STUDY)
    on_ray = typer.Option(False, "--ray", help=RAY)
    names = typer.Option([], "--parameter", help=ONLY)

    @app.command("rank", help=rank.__doc__)
    def _(
        study: Path = study_file,
        out: Path = folder,
        *,
        samples: int = typer.Option(
            64, min=2, help="Number of base samples, a power of 2. The command runs samples x (2 + number of parameters) points."
        ),
        parameter: list[str] = names,
        setting: str = typer.Option(USUAL, help="Name of the study's settings to run."),
        seed: int | None = typer.Option(None, min=0, help=SEED),
        ray: bool = on_ray,
    ) -> None:
        rank(study, out, samples=samples, parameters=parameter, setting=setting, ray=ray, seed=seed)
