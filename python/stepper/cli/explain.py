"""`stepper explain`."""

from __future__ import annotations

import warnings
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.loading import ModelWarning, load

if TYPE_CHECKING:
    from typer import Typer


def explain(model: str) -> None:
    """What of a model is simulated, what is left out and why, and what rigid bodies cannot model."""
    with warnings.catch_warnings():
        # The report has it.
        warnings.simplefilter("ignore", ModelWarning)
        print(load(model, strict=False).explain())


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""

    @app.command("explain", help=explain.__doc__)
    def _(model: str = typer.Argument(help="An .xml, .urdf or saved model.")) -> None:
        explain(model)
