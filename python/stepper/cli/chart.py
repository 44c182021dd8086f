"""Command `stepper chart`: error against cost of time steps, integrators, solvers, contact laws and engines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Out, RayRuns, Source, Values, show, source_with
from stepper.lab.accuracy import chart as run
from stepper.lab.progress import show_progress


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
    ray: RayRuns = False,
) -> None:
    """Draws charts of simulation error against computing time, to compare time steps, integrators, solvers, contact laws and engines.

    The command computes a converged reference of a model or a study, and its uncertainty. It attributes errors to the solver, the time
    step and the contact law. It also lists invariants and distributions of outcomes, which are meaningful for chaotic motion, too.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    if not Path(scene).exists():
        raise ValueError(f'there is no file "{scene}": give the path of a model or a study')
    with show_progress() as progress:
        source = source_with(scene, ray=ray, values=values or ())
        unit = "rad" if angle else "m"
        found = run(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, budget=budget, progress=progress)
    show(found)
