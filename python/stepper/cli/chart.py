"""Command `stepper chart`: error against cost of time steps, integrators, solvers, contact laws and engines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT, RAY_RUNS, VALUES, source_with
from stepper.lab.accuracy import chart as run
from stepper.lab.progress import show_files, show_progress

if TYPE_CHECKING:
    from typer import Typer


def chart(
    scene: str,
    out: Path,
    *,
    quick: bool,
    horizon: str | None,
    angle: bool,
    episodes: int,
    budget: str | None,
    ray: bool,
    values: Sequence[str] = (),
) -> None:
    """Draws charts of simulation error against computing time, to compare time steps, integrators, solvers, contact laws and engines.

    The command computes a converged reference of a model or a study, and its uncertainty. It attributes errors to the solver, the time
    step and the contact law. It also lists invariants and distributions of outcomes, which are meaningful for chaotic motion, too.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    if not Path(scene).exists():
        raise ValueError(f'there is no file "{scene}": give the path of a model or a study')
    with show_progress() as progress:
        source = source_with(scene, ray=ray, values=values)
        unit = "rad" if angle else "m"
        found = run(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, budget=budget, progress=progress)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `chart` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    on_ray = typer.Option(False, "--ray", help=RAY_RUNS)
    chosen = typer.Option([], "--values", help=VALUES)

    @app.command("chart", help=chart.__doc__)
    def _(
        scene: str = typer.Argument(help="Model (MJCF, URDF, saved) or study (.toml, .py)."),
        *,
        out: Path = folder,
        quick: bool = typer.Option(False, "--quick", help="Fewer repeats, settings and time steps; at most two minutes of processor time."),
        horizon: str | None = typer.Option(
            None, help='Simulated time up to which errors are measured, such as "0.5 s"; by default, as long as the reference is converged.'
        ),
        angle: bool = typer.Option(False, "--angle", help="Measure errors as angles in rad, not distances in m."),
        episodes: int = typer.Option(8, min=1, help="Number of episodes; the chart shows their medians."),
        budget: str | None = typer.Option(None, help='Limit of the processor time, "60 s"; the report lists runs that were left out.'),
        values: list[str] = chosen,
        ray: bool = on_ray,
    ) -> None:
        chart(scene, out, quick=quick, horizon=horizon, angle=angle, episodes=episodes, budget=budget, ray=ray, values=values)
