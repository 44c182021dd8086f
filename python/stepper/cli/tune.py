"""Command `stepper tune`: cheapest settings within an error budget."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out, RayRuns, Source, Values, show, source_with
from stepper.lab.accuracy import tune as run
from stepper.lab.progress import show_progress


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
    ray: RayRuns = False,
) -> None:
    """Finds the cheapest settings within an error budget, tests them on further episodes, and prints them as Options(...).

    The command also lists parts of the scene that can be removed within the budget.

    Example: stepper tune robot.xml --error "1 mm" --horizon "0.5 s"
    """
    with show_progress() as progress:
        chosen = source_with(source, ray=ray, values=values or ())
        found = run(chosen, out, error=error, horizon=horizon, coverage=coverage, alone=alone, reduce=reduce, progress=progress)
    show(found)
