"""Commands of studies: `stepper chart`, `tune`, `sweep`, `rank`, `report`, `calibrate`, `compare` and `explain`."""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from stepper import lab
from stepper.cli.options import (
    RECORDING,
    STUDY,
    Out,
    Ray,
    Seed,
    Setting,
    Source,
    StudyFile,
    Values,
    Varied,
    progress_kept_in,
    show,
    source_with,
    study_of_file,
    values_of,
)
from stepper.lab.study.document import Document, Section, check_pages
from stepper.lab.study.points import USUAL
from stepper.loading import ModelWarning
from stepper.loading.findings import explained
from stepper.recording.format import HEADER, end_of, find_blocks, read_header, reading
from stepper.shared.files import locked, write_text
from stepper.shared.machine import provenance
from stepper.shared.progress import show_files, show_progress


def chart(
    scene: Source,
    *,
    out: Out = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repeats, settings and time steps; at most two minutes of processor time.")
    ] = False,
    horizon: Annotated[
        str | None,
        typer.Option(
            help='Simulated time up to which errors are measured, such as "0.5 s"; by default, as long as the reference is converged.'
        ),
    ] = None,
    angle: Annotated[bool, typer.Option("--angle", help="Measure errors as angles in rad, not distances in m.")] = False,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes; the chart shows their medians.")] = 8,
    budget: Annotated[
        str | None, typer.Option(help='Limit of the processor time, "60 s"; the report lists runs that were left out.')
    ] = None,
    values: Values = None,
) -> None:
    """Draws charts of simulation error against computing time, to compare time steps, integrators, solvers, contact laws and engines.

    The command computes a converged reference of a model or a study, and its uncertainty. It attributes errors to the solver, the time
    step and the contact law. It also lists invariants and distributions of outcomes, which are meaningful for chaotic motion, too.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    if not Path(scene).exists():
        raise ValueError(f'there is no file "{scene}": give the path of a model or a study')
    with show_progress() as progress:
        source = source_with(scene, values)
        unit = "rad" if angle else "m"
        found = lab.chart(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, budget=budget, progress=progress)
    show(found)


def tune(
    source: Source,
    *,
    error: Annotated[str, typer.Option(help='Error budget: "1 mm", "0.5 deg".')],
    horizon: Annotated[str, typer.Option(help='Simulated time up to which the error must stay within the budget: "1 s".')],
    out: Out = Path("out"),
    coverage: Annotated[float, typer.Option(help="Fraction of episodes that must stay within the budget, with 95 % confidence.")] = 0.9,
    alone: Annotated[bool, typer.Option("--alone", help="Minimise the cost of a single environment, not of a batch.")] = False,
    reduce: Annotated[bool, typer.Option(help="Search for parts of the scene that can be removed.")] = True,
    values: Values = None,
) -> None:
    """Finds the cheapest settings within an error budget, tests them on further episodes, and prints them as Options(...).

    The command also lists parts of the scene that can be removed within the budget.

    Example: stepper tune robot.xml --error "1 mm" --horizon "0.5 s"
    """
    with show_progress() as progress:
        chosen = source_with(source, values)
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
    ray: Ray = False,
) -> None:
    """Ranks the parameters of a study by their influence on an outcome: Sobol indices with confidence intervals.

    All parameters vary together over their ranges. The same command continues a stopped run after the last stored result.

    Example: stepper rank examples/studies/quadruped.py --samples 128
    """
    with progress_kept_in(out) as progress:
        own = study_of_file(study, ray=ray, seed=seed)
        found = lab.rank(own, out, samples=samples, parameters=parameter or None, setting=setting, progress=progress)
    show(found)


def report(source: Annotated[Path, typer.Argument(help=f"{STUDY} Or: {RECORDING}")], out: Out = Path("out"), ray: Ray = False) -> None:
    """Writes the simulator report of a study: state, sensors, decisive contacts, settings, perturbations, transfer gap and failures.

    For a recording, the command prints the settings, and where it ends if it was cut off.

    Example: stepper report examples/studies/tray.toml
    """
    if source.is_dir():
        report_recording(source)
        return
    with progress_kept_in(out) as progress:
        found = lab.report(study_of_file(source, ray=ray), out, progress=progress)
    show(found)


def report_recording(recording: Path) -> None:
    """Prints the settings of a recording, and where it ends if it was cut off."""
    head = read_header(recording)
    rows = sum(block.rows for block in find_blocks(recording, head))
    end = end_of(recording, head)
    with reading(recording / HEADER):
        _report(recording, head | {"rows": rows}, end)


def _report(recording: Path, head: dict[str, Any], end: str) -> None:
    """Prints the contents of a recording's header."""
    envs = "one environment" if head["num_envs"] is None else f"{head['num_envs']} environments"
    print(f'{recording}: {head["rows"]} rows of {envs} of "{head["model"]["name"]}", dt {head["timestep"]:g} s, {head["precision"]}')
    if end:
        print(end)
    print(f"model {head['model']['sha256']}")
    if head["note"]:
        print(f"note: {head['note']}")
    settings = head["options"] | {"tolerance": head["tolerance"], "seed": head["seed"]}
    print(", ".join(f"{name} {value}" for name, value in settings.items() if value is not None))


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
    measured: Annotated[
        list[str] | None,
        typer.Option(help="Tolerance of a measurement, 'friction=0.01' in its unit, to certify without a search. Repeat it for more."),
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
    found: lab.Calibration | lab.RecordedCalibration
    with progress_kept_in(out) as progress:
        own, names = study_of_file(study, ray=ray, seed=seed), parameter or None
        if recordings is not None:
            found = lab.calibrate_on_recordings(
                own, out, fitted=recordings, margin=margin, parameters=names, setting=setting, progress=progress
            )  # fmt: skip
        else:
            found = lab.calibrate(
                own, out, margin=margin, samples=samples, worlds=worlds, tries=tries, parameters=names,
                tolerances=_tolerances(measured), setting=setting, progress=progress,
            )  # fmt: skip
    show(found)


def _tolerances(texts: list[str] | None) -> dict[str, float] | None:
    """Tolerances by parameter, of texts such as "friction=0.01"; None without texts."""
    found = {}
    for text in texts or ():
        name, _, value = text.rpartition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise typer.BadParameter(f"--measured is {text!r}, must be NAME=TOLERANCE, such as 'friction=0.01'") from None
    return found or None


def compare(
    model: Annotated[str, typer.Argument(help="MJCF, URDF or a saved model.")],
    out: Out = Path("out"),
    seconds: Annotated[float, typer.Option(help="Length of an episode, s.")] = 2.0,
    num_envs: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 8,
    seed: Annotated[int, typer.Option(help="Seed of the random controls.")] = 0,
) -> None:
    """Compares hard contact, MuJoCo's contact law in stepper, and MuJoCo, on a model with random controls.

    The command prints a table and draws a picture.

    Example: stepper compare humanoid.xml --seconds 3
    """
    with locked(out):
        with show_progress() as progress:
            found = lab.compare(model, seconds=seconds, num_envs=num_envs, seed=seed, progress=progress)
        print(found.table())
        show_files([found.draw(out / "compare.png")])


def explain(
    source: Source,
    run: Annotated[
        bool,
        typer.Option(
            "--run", help="Also run the model or study (a model with random controls), and list the parts that were used and their cost."
        ),
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Output folder. Without it, no files are written.")] = None,
) -> None:
    """Lists the parts of a model that are simulated, those that are left out, and effects that rigid bodies cannot model.

    With --run, the command also lists the parts that a run used and the time that they took.

    Example: stepper explain robot.xml --run
    """
    if out is not None:
        check_pages()
    study = lab.Study.from_model(Path(source))
    with warnings.catch_warnings():
        # The report contains the warnings.
        warnings.simplefilter("ignore", ModelWarning)
        text = explained(study.loaded[0])
    print(text)
    found = _profile(study) if run else None
    if found is not None:
        print(found.document.markdown())
    if out is not None:
        with locked(out / study.name) as folder:
            files = _save(study, text, found, folder)
        show_files(files)


def _profile(study: lab.Study) -> lab.CostProfile:
    """Runs a study with a progress display. Returns the parts of the scene that the run used, with the computing cost of each part."""
    with show_progress() as progress:
        return lab.profile(study, progress=progress)


def _save(study: lab.Study, text: str, found: lab.CostProfile | None, folder: Path) -> list[Path]:
    """Writes the printed report as explain.html, explain.md and explain.json."""
    document = Document(f"Simulated parts of {study.name}", [Section("The model", text=text), *(found.document.sections if found else [])])
    numbers = {"uses": [asdict(use) for use in found.uses], "parts": [asdict(part) for part in found.parts]} if found else {}
    plain = {"model": text, **numbers, "resolved_settings": study.resolved_settings(), "provenance": provenance()}
    text = json.dumps(plain, indent=2, default=str, allow_nan=False) + "\n"
    return [*document.save(folder, "explain"), write_text(folder / "explain.json", text)]
