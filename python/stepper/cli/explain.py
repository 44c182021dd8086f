"""Command `stepper explain`: parts of a model that are simulated, used by a run, or left out."""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Source
from stepper.lab.accuracy import CostProfile, profile
from stepper.lab.progress import show_files, show_progress
from stepper.lab.study import Study
from stepper.lab.study.document import Document, Section, check_pages
from stepper.loading import ModelWarning
from stepper.loading.findings import explained
from stepper.shared.files import locked, write_text
from stepper.shared.machine import provenance


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
    study = Study.from_model(Path(source))
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


def _profile(study: Study) -> CostProfile:
    """Runs a study with a progress display. Returns the parts of the scene that the run used, with the computing cost of each part."""
    with show_progress() as progress:
        return profile(study, progress=progress)


def _save(study: Study, text: str, found: CostProfile | None, folder: Path) -> list[Path]:
    """Writes the printed report as explain.html, explain.md and explain.json."""
    document = Document(f"Simulated parts of {study.name}", [Section("The model", text=text), *(found.document.sections if found else [])])
    numbers = {"uses": [asdict(use) for use in found.uses], "parts": [asdict(part) for part in found.parts]} if found else {}
    plain = {"model": text, **numbers, "resolved_settings": study.resolved_settings(), "provenance": provenance()}
    text = json.dumps(plain, indent=2, default=str, allow_nan=False) + "\n"
    return [*document.save(folder, "explain"), write_text(folder / "explain.json", text)]
