"""Command `stepper calibrate`: the smallest set of parameters that must be measured, with a certificate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out, Ray, Seed, Setting, StudyFile, Varied, progress_kept_in, show, study_of_file
from stepper.lab.calibration import Calibration, RecordedCalibration, calibrate_on_recordings
from stepper.lab.calibration import calibrate as run
from stepper.lab.study.points import USUAL


def calibrate(
    study: StudyFile,
    out: Out = Path("out"),
    *,
    margin: Annotated[
        float, typer.Option(help="Largest difference between world and model: of the fraction of successes, or of the outcome in its unit.")
    ],
    samples: Annotated[int, typer.Option(min=2, help="Number of base samples of the ranking, a power of 2; not with --recordings.")] = 64,
    worlds: Annotated[
        int,
        typer.Option(
            min=59,
            help="Number of worlds of the search, of each certificate, and of the test of minimality; 80 or more with three tries.",
        ),
    ] = 208,
    tries: Annotated[
        int, typer.Option(min=1, help="Largest number of certificates that are tried; they share the probability of an error.")
    ] = 3,
    recordings: Annotated[
        int | None,
        typer.Option(
            min=1, help="Number of recordings to fit: the first episodes of a study whose episodes are recordings. The others check."
        ),
    ] = None,
    parameter: Varied = None,
    setting: Setting = USUAL,
    seed: Seed = None,
    ray: Ray = False,
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
        own, names = study_of_file(study, ray=ray, seed=seed), parameter or None
        if recordings is not None:
            found = calibrate_on_recordings(
                own, out, fitted=recordings, margin=margin, parameters=names, setting=setting, progress=progress
            )  # fmt: skip
        else:
            found = run(
                own, out, margin=margin, samples=samples, worlds=worlds, tries=tries, parameters=names, setting=setting, progress=progress
            )
    show(found)
