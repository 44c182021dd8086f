"""Command `stepper rank`: ranking of a study's parameters by their influence on the outcome."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out, Ray, Seed, Setting, StudyFile, Varied, progress_kept_in, show, study_of_file
from stepper.lab.study import rank as run
from stepper.lab.study.points import USUAL


def rank(
    study: StudyFile,
    out: Out = Path("out"),
    *,
    samples: Annotated[
        int, typer.Option(min=2, help="Number of base samples, a power of 2. The command runs samples x (2 + number of parameters) points.")
    ] = 64,
    parameter: Varied = None,
    setting: Setting = USUAL,
    seed: Seed = None,
    ray: Ray = False,
) -> None:
    """Ranks the parameters of a study by their influence on an outcome: Sobol indices with confidence intervals.

    All parameters vary together over their ranges. The same command continues a stopped run after the last stored result.

    Example: stepper rank examples/studies/quadruped.py --samples 128
    """
    with progress_kept_in(out) as progress:
        own = study_of_file(study, ray=ray, seed=seed)
        found = run(own, out, samples=samples, parameters=parameter or None, setting=setting, progress=progress)
    show(found)
