"""Commands of studies: `stepper chart`, `tune`, `sweep`, `rank`, `report`, `calibrate` and `explain`."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from stepper import lab
from stepper.cli.options import (
    Data,
    Out,
    Seed,
    Setting,
    Source,
    StudyFile,
    Values,
    Varied,
    number_or_text,
    progress_kept_in,
    show,
    source_with,
    study_of_file,
    values_of,
)
from stepper.lab.study.batches import USUAL
from stepper.lab.study.document import Document, Section, check_pages
from stepper.loading import ModelWarning
from stepper.loading.findings import explained
from stepper.shared.arguments import name_values
from stepper.shared.files import locked, write_text
from stepper.shared.machine import provenance
from stepper.shared.progress import show_files, show_progress


def chart(
    scene: Source,
    *,
    out: Out = Path("out"),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer repeats, settings and time steps.")] = False,
    horizon: Annotated[
        str | None,
        typer.Option(
            help='Simulated time up to which errors are measured, such as "0.5 s"; by default, as long as the reference is converged.'
        ),
    ] = None,
    angle: Annotated[bool, typer.Option("--angle", help="Measure errors as angles in rad, not distances in m.")] = False,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes; the chart shows their medians.")] = 8,
    values: Values = None,
    data: Data = None,
) -> None:
    """Draws charts of simulation error against computing time, to compare time steps, integrators, solvers, contact laws and engines.

    The command computes a converged reference of a model or a study, and its uncertainty. It attributes errors to the solver, the time
    step and the contact law. It also lists invariants and distributions of outcomes, which are meaningful for chaotic motion, too.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    if not Path(scene).exists():
        raise ValueError(f'there is no file "{scene}": give the path of a model or a study')
    with show_progress() as progress:
        source = source_with(scene, values, data)
        unit = "rad" if angle else "m"
        found = lab.chart(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, progress=progress)
    show(found)


def tune(
    source: Source,
    *,
    error: Annotated[str, typer.Option(help='Error budget: "1 mm", "0.5 deg".')],
    horizon: Annotated[str, typer.Option(help='Simulated time up to which the error must stay within the budget: "1 s".')],
    out: Out = Path("out"),
    coverage: Annotated[float, typer.Option(help="Fraction of episodes that must stay within the budget, with 95 % confidence.")] = 0.9,
    alone: Annotated[bool, typer.Option("--alone", help="Minimise the cost of a single environment, not of a batch.")] = False,
    reduce: Annotated[bool, typer.Option(help="Search for pairs of bodies that never come near each other.")] = True,
    values: Values = None,
    data: Data = None,
) -> None:
    """Finds the cheapest settings within an error budget, tests them on further episodes, and prints them as Options(...).

    The command also excludes pairs of bodies that never came near each other from contact, if that saves time within the budget.

    Example: stepper tune robot.xml --error "1 mm" --horizon "0.5 s"
    """
    with show_progress() as progress:
        chosen = source_with(source, values, data)
        found = lab.tune(chosen, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, progress=progress)
    show(found)


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
    data: Data = None,
) -> None:
    """Varies the parameters of a study over their ranges, one parameter at a time, and prints success rates and cliffs.

    Success rates have Wilson confidence intervals. A cliff is a parameter value at which episodes change from success to failure; bisection
    locates it. With --parameter, the command varies only the named parameters. --values sets nominal values of other parameters. The same
    command continues a stopped run after the last stored result.

    Example: stepper sweep examples/studies/tray.toml

    Example: stepper sweep examples/studies/tray.toml --parameter friction --parameter 'body_mass[object]=0.2..0.5'

    Example: stepper sweep examples/studies/tray.toml --parameter friction --values push=1.5 --values 'gravity[2]=-3.7'
    """
    own = study_of_file(study, seed, data)
    # A selector of --values becomes a parameter of the study, which the sweep does not vary.
    names = parameter or (list(own.parameters) if values else None)
    with progress_kept_in(out) as progress:
        found = lab.sweep(own.at(values_of(values or ())), out, parameters=names, cliffs=cliffs, resolution=resolution, progress=progress)
    show(found)


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
    data: Data = None,
) -> None:
    """Ranks the parameters of a study by their influence on an outcome: Sobol indices with confidence intervals.

    All parameters vary together over their ranges. The same command continues a stopped run after the last stored result.

    Example: stepper rank examples/studies/quadruped.py --samples 128
    """
    with progress_kept_in(out) as progress:
        own = study_of_file(study, seed, data)
        found = lab.rank(own, out, samples=samples, parameters=parameter or None, setting=setting, progress=progress)
    show(found)


def report(study: StudyFile, out: Out = Path("out"), *, data: Data = None) -> None:
    """Writes the simulator report of a study: state, sensors, decisive contacts, settings, perturbations, transfer gap and failures.

    Example: stepper report examples/studies/tray.toml
    """
    with progress_kept_in(out) as progress:
        found = lab.report(study_of_file(study, data=data), out, progress=progress)
    show(found)


def calibrate(
    study: StudyFile,
    out: Out = Path("out"),
    *,
    margin: Annotated[
        float, typer.Option(help="Largest difference between world and model: of the fraction of successes, or of the outcome in its unit.")
    ],
    samples: Annotated[
        int, typer.Option(min=2, help="Number of base samples of the ranking, a power of 2; not with --fit-trajectories.")
    ] = 64,
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
    fit_trajectories: Annotated[
        int | None,
        typer.Option(
            min=1, help="Number of measured trajectories to fit: the first episodes of a study whose episodes are such. The others check."
        ),
    ] = None,
    measured: Annotated[
        list[str] | None,
        typer.Option(help="Tolerance of a measurement, 'friction=0.01' in its unit, to certify without a search. Repeat it for more."),
    ] = None,
    parameter: Varied = None,
    setting: Setting = USUAL,
    seed: Seed = None,
    data: Data = None,
) -> None:
    """Finds the smallest set of parameters that must be measured, so that the outcome is that of the true world to within a margin.

    The command ranks the parameters, searches for the set and its widest tolerances, and tests both on fresh worlds. The certificate covers
    95 % of the worlds in the ranges, with 95 % confidence. The same command continues a stopped run after the last stored result.

    With --fit-trajectories N, the episodes of the study are measured trajectories of a real system, and the outcome is the error of a
    prediction. The first N are fitted. The fit of the smallest set exceeds the error of a fit of all parameters by at most the margin. The
    others check it.

    Example: stepper calibrate examples/studies/pushed_box.py --margin 0.2
    """
    found: lab.Calibration | lab.TrajectoryCalibration
    with progress_kept_in(out) as progress:
        own, names = study_of_file(study, seed, data), parameter or None
        if fit_trajectories is not None:
            found = lab.calibrate_on_trajectories(
                own, out, fitted=fit_trajectories, margin=margin, parameters=names, setting=setting, progress=progress
            )  # fmt: skip
        else:
            tolerances: Any = name_values(measured, "--measured", number_or_text) if measured else None
            found = lab.calibrate(
                own, out, margin=margin, samples=samples, worlds=worlds, tries=tries, parameters=names, tolerances=tolerances,
                setting=setting, progress=progress,
            )  # fmt: skip
    show(found)


def explain(
    source: Source,
    out: Annotated[Path | None, typer.Option("--out", help="Output folder. Without it, no files are written.")] = None,
) -> None:
    """Lists the parts of a model that are simulated, those that are left out, and effects that rigid bodies cannot model.

    Example: stepper explain robot.xml
    """
    if out is not None:
        check_pages()
    study = lab.Study.from_model(Path(source))
    with warnings.catch_warnings():
        # The report contains the warnings.
        warnings.simplefilter("ignore", ModelWarning)
        text = explained(study.loaded[0])
    print(text)
    if out is not None:
        document = Document(f"Simulated parts of {study.name}", [Section("The model", text=text)])
        plain = {"model": text, "resolved_settings": study.resolved_settings(), "provenance": provenance()}
        with locked(out / study.name) as folder:
            numbers = write_text(folder / "explain.json", json.dumps(plain, indent=2, default=str, allow_nan=False) + "\n")
            files = [*document.save(folder, "explain"), numbers]
        show_files(files)
