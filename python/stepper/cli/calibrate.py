"""Command `stepper calibrate`: the smallest set of parameters that must be measured, with a certificate."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import ONLY, OUT, RAY, SEED, STUDY, progress_kept_in, study_of_file
from stepper.lab.calibration import Calibration, RecordedCalibration, calibrate_on_recordings
from stepper.lab.calibration import calibrate as run
from stepper.lab.progress import show_files
from stepper.lab.study.points import USUAL

if TYPE_CHECKING:
    from typer import Typer


def calibrate(
    study: Path,
    out: Path,
    *,
    margin: float,
    samples: int,
    worlds: int,
    tries: int,
    recordings: int | None,
    parameters: list[str],
    setting: str,
    ray: bool,
    seed: int | None,
) -> None:
    """Finds the smallest set of parameters that must be measured, so that the outcome is that of the true world to within a margin.

    The command ranks the parameters, searches for the set and its widest tolerances, and tests both on fresh worlds. The certificate covers
    95 % of the worlds in the ranges, with 95 % confidence. The same command continues a stopped run after the last stored result.

    With --recordings N, the episodes of the study are recordings of a real system, and the outcome is the error of a prediction. The first
    N are fitted. The fit of the smallest set exceeds the error of a fit of all parameters by at most the margin. The others check it.

    Example: stepper calibrate examples/studies/pushed_box.py --margin 0.2
    """
    found: Calibration | RecordedCalibration
    with progress_kept_in(out) as progress:
        own, names = study_of_file(study, ray=ray, seed=seed), parameters or None
        if recordings is not None:
            found = calibrate_on_recordings(
                own, out, fitted=recordings, margin=margin, parameters=names, setting=setting, progress=progress
            )  # fmt: skip
        else:
            found = run(
                own, out, margin=margin, samples=samples, worlds=worlds, tries=tries, parameters=names, setting=setting, progress=progress
            )
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `calibrate` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    study_file = typer.Argument(help=STUDY)
    on_ray = typer.Option(False, "--ray", help=RAY)
    names = typer.Option([], "--parameter", help=ONLY)

    @app.command("calibrate", help=calibrate.__doc__)
    def _(
        study: Path = study_file,
        out: Path = folder,
        *,
        margin: float = typer.Option(
            ..., help="Largest difference between world and model: of the fraction of successes, or of the outcome in its unit."
        ),
        samples: int = typer.Option(64, min=2, help="Number of base samples of the ranking, a power of 2; not with --recordings."),
        worlds: int = typer.Option(
            208,
            min=59,
            help="Number of worlds of the search, of each certificate, and of the test of minimality; 80 or more with three tries.",
        ),
        tries: int = typer.Option(3, min=1, help="Largest number of certificates that are tried; they share the probability of an error."),
        recordings: int | None = typer.Option(
            None, min=1, help="Number of recordings to fit: the first episodes of a study whose episodes are recordings. The others check."
        ),
        parameter: list[str] = names,
        setting: str = typer.Option(USUAL, help="Name of the study's settings to run."),
        seed: int | None = typer.Option(None, min=0, help=SEED),
        ray: bool = on_ray,
    ) -> None:
        calibrate(
            study,
            out,
            margin=margin,
            samples=samples,
            worlds=worlds,
            tries=tries,
            recordings=recordings,
            parameters=parameter,
            setting=setting,
            ray=ray,
            seed=seed,
        )
