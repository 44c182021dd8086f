"""Command `stepper report`: simulator report of a study, or failures in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from stepper.cli.options import RECORDING, STUDY, Out, Ray, progress_kept_in, show, study_of_file
from stepper.lab.study import report as run
from stepper.recording.format import HEADER, end_of, find_blocks, read_header, reading


def report(source: Annotated[Path, typer.Argument(help=f"{STUDY} Or: {RECORDING}")], out: Out = Path("out"), ray: Ray = False) -> None:
    """Writes the simulator report of a study: state, sensors, decisive contacts, settings, perturbations, transfer gap and failures.

    For a recording, the command prints the settings and the failures in physics, sensing or action.

    Example: stepper report examples/studies/tray.toml
    """
    if source.is_dir():
        report_recording(source)
        return
    with progress_kept_in(out) as progress:
        found = run(study_of_file(source, ray=ray), out, progress=progress)
    show(found)


def report_recording(recording: Path) -> None:
    """Prints the settings and the failures of a recording."""
    head = read_header(recording)
    rows = sum(block.rows for block in find_blocks(recording, head))
    end = end_of(recording, head)
    with reading(recording / HEADER):
        _report(recording, head | {"rows": rows}, end)


def _report(recording: Path, head: dict[str, Any], end: str) -> None:
    """Prints the settings and failures of a recording."""
    envs = "one environment" if head["num_envs"] is None else f"{head['num_envs']} environments"
    print(f'{recording}: {head["rows"]} rows of {envs} of "{head["model"]["name"]}", dt {head["timestep"]:g} s, {head["precision"]}')
    if end:
        print(end)
    print(f"model {head['model']['sha256']}")
    if head["note"]:
        print(f"note: {head['note']}")
    settings = head["options"] | {"tolerance": head["tolerance"], "seed": head["seed"]}
    print(", ".join(f"{name} {value}" for name, value in settings.items() if value is not None))
    for failure in head["failures"]:
        row, env = failure["first"][0]
        word = "steps" if "steps" in failure else "readings"
        counts = ", ".join(f"{name} {count}" for name, count in failure.get(word, {}).items())
        print(
            f"{failure['cause']}: {failure['count']} times {failure['meaning']}, first in row {row}, environment {env}"
            + (f"; {word}: {counts}" if counts else "")
        )
    if not head["failures"]:
        print("no failures")
