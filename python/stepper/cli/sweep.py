"""Command `stepper sweep`: variation of each parameter of a study over its range."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out, Ray, Seed, StudyFile, Values, Varied, progress_kept_in, show, study_of_file, values_of
from stepper.lab.study import sweep as run


def sweep(
    study: StudyFile,
    out: Out = Path("out"),
    *,
    parameter: Varied = None,
    values: Values = None,
    cliffs: Annotated[bool, typer.Option(help="Locate cliffs, the values at which episodes change from success to failure.")] = True,
    resolution: Annotated[
        float, typer.Option(min=1e-12, max=0.5, help="Precision of a cliff's value, as a fraction of the parameter's range.")
    ] = 1e-3,
    seed: Seed = None,
    ray: Ray = False,
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
    names = parameter or (list(own.parameters) if values else None)
    with progress_kept_in(out) as progress:
        found = run(own.at(values_of(values or ())), out, parameters=names, cliffs=cliffs, resolution=resolution, progress=progress)
    show(found)
