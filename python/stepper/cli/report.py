"""Command `stepper report`: simulator report of a study, or failures in a recording."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from stepper.cli.options import OUT, RAY, RECORDING, STUDY, progress_kept_in, study_of_file
from stepper.lab.progress import show_files
from stepper.lab.study import report as run
from stepper.recording.format import HEADER, end_of, find_blocks, read_header, reading

if TYPE_CHECKING:
    from typer import Typer


def report(source: Path, out: Path = Path("out"), *, ray: bool = False) -> None:
    """Writes the simulator report of a study: state, sensors, decisive contacts, settings, perturbations, transfer gap and failures.

    For a recording, the command prints the settings and the failures in physics, sensing or action.

    Example: stepper report examples/studies/tray.toml
    """
    if source.is_dir():
        report_recording(source)
        return
    with progress_kept_in(out) as progress:
        found = run(study_of_file(source, ray=ray), out, progress=progress)
    print(found.document.markdown())
    show_files(found.files)


def report_recording(recording: Path) -> None:
    """Prints the settings and the failures of a recording."""
    head = read_header(recording)
    rows = sum(block.rows for block in find_blocks(recording, head))
    end = end_of(recording, head)
    with reading(recording / HEADER):
        _report(recording, head | {"rows": rows}, end)


def _report(recording: Path, head: dict[str, Any], end: str) -> None:
    """Prints the settings and failures of a recording.

    Args:
        recording: Folder of the recording.
        head: Contents of its file run.json.
        end: Text on the end of a recording that was not closed; "" for a closed one.
    """
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


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `report` to the Typer application; `typer` is the module."""
    place = typer.Argument(help=f"{STUDY} Or: {RECORDING}")
    folder = typer.Option("out", "--out", help=OUT)

    @app.command("report", help=report.__doc__)
    def _(source: Path = place, out: Path = folder, ray: bool = typer.Option(False, "--ray", help=RAY)) -> None:
        report(source, out, ray=ray)
