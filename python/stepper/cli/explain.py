"""`stepper explain`."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.experiments.accuracy import account
from stepper.experiments.study import Study
from stepper.loading import ModelWarning

if TYPE_CHECKING:
    from typer import Typer


def explain(source: str, *, run: bool = False) -> None:
    """What of a model is simulated, what is left out, what rigid bodies cannot model; with --run, what of it a run used, and costs.

    Example: stepper explain robot.xml --run
    """
    study = Study.of(Path(source))
    with warnings.catch_warnings():
        # The report has it.
        warnings.simplefilter("ignore", ModelWarning)
        print(study.loaded[0].explain())
    if run:
        print(account(study).document.markdown())


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""

    @app.command("explain", help=explain.__doc__)
    def _(
        source: str = typer.Argument(help="A model (MJCF, URDF, saved) or a study (.toml, .py)."),
        run: bool = typer.Option(False, "--run", help="Run it (a model with random controls), and add what it used and what parts cost."),
    ) -> None:
        explain(source, run=run)
