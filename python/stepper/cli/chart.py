"""Command `stepper chart`: error against cost of time steps, integrators, solvers, contact laws and engines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT, RAY_RUNS, VALUES, source_with
from stepper.lab.accuracy import chart as run
from stepper.lab.engine_chart import SCENES, Effort, charts
from stepper.lab.progress import progress, show_files
from stepper.shared.files import locked

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

    The scene is your model or study, or a built-in scene with a known solution. For a model or study, the command computes a converged
    reference and its uncertainty. It attributes errors to the solver, the time step and the contact law. It also lists invariants and
    distributions of outcomes, which are meaningful for chaotic motion, too.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    names = list(SCENES)
    if scene in (*names, "all"):
        if ray or budget or values:
            which = "--ray" if ray else "--budget" if budget else "--values"
            raise ValueError(f'{which} has no effect on "{scene}", which is a built-in scene: leave it out')
        with locked(out), progress() as tick:
            pictures = charts(names if scene == "all" else [scene], out, Effort.quick() if quick else Effort(), tick)
        show_files([file for picture in pictures for file in (picture, picture.with_suffix(".csv"))])
        return
    if not Path(scene).exists():
        raise ValueError(f'there is no file and no built-in scene "{scene}"; scenes are: {", ".join(names)}, all')
    with progress() as tick:
        source = source_with(scene, ray=ray, values=values)
        unit = "rad" if angle else "m"
        found = run(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, budget=budget, tick=tick)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `chart` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    on_ray = typer.Option(False, "--ray", help=RAY_RUNS)
    chosen = typer.Option([], "--values", help=VALUES)

    @app.command("chart", help=chart.__doc__)
    def _(
        scene: str = typer.Argument("all", help="Model (MJCF, URDF, saved), study (.toml, .py), or built-in scene: chain, box, all."),
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
