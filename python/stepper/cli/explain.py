"""`stepper explain`."""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT
from stepper.lab.accuracy import Account, account
from stepper.lab.progress import progress, show_files
from stepper.lab.study import Study
from stepper.lab.study.document import Document, Section, check_pages
from stepper.loading import ModelWarning
from stepper.shared.machine import provenance

if TYPE_CHECKING:
    from typer import Typer


def explain(source: str, *, run: bool = False, out: Path | None = None) -> None:
    """What of a model is simulated, what is left out, what rigid bodies cannot model; with --run, what of it a run used, and costs.

    Example: stepper explain robot.xml --run
    """
    if out is not None:
        check_pages()
    study = Study.from_model(Path(source))
    with warnings.catch_warnings():
        # The report has it.
        warnings.simplefilter("ignore", ModelWarning)
        told = study.loaded[0].explain()
    print(told)
    found = _account(study) if run else None
    if found is not None:
        print(found.document.markdown())
    if out is not None:
        show_files(_save(study, told, found, out / study.name))


def _account(study: Study) -> Account:
    """What a run used and cost, with progress."""
    with progress() as tick:
        return account(study, tick=tick)


def _save(study: Study, told: str, found: Account | None, folder: Path) -> list[Path]:
    """Writes what was printed as explain.html and explain.md, and the same as explain.json."""
    folder.mkdir(parents=True, exist_ok=True)
    document = Document(
        f"What of {study.name} is simulated", [Section("The model", text=told), *(found.document.sections if found else [])]
    )
    files = [*document.save(folder, "explain"), folder / "explain.json"]
    numbers = {"uses": [asdict(use) for use in found.uses], "parts": [asdict(part) for part in found.parts]} if found else {}
    plain = {"model": told, **numbers, "in_force": study.in_force, "provenance": provenance()}
    files[-1].write_text(json.dumps(plain, indent=2, default=str, allow_nan=False) + "\n", encoding="utf-8")
    return files


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    folder = typer.Option(None, "--out", help=f"{OUT} Without it, nothing is written.")

    @app.command("explain", help=explain.__doc__)
    def _(
        source: str = typer.Argument(help="A model (MJCF, URDF, saved) or a study (.toml, .py)."),
        run: bool = typer.Option(False, "--run", help="Run it (a model with random controls), and add what it used and what parts cost."),
        out: Path | None = folder,
    ) -> None:
        explain(source, run=run, out=out)
