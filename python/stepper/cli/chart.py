"""`stepper chart`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.cli.options import OUT, RAY_RUNS, VALUES, of_source
from stepper.lab.accuracy import chart as run
from stepper.lab.engine_chart import SCENES, Effort, charts
from stepper.lab.progress import progress, show_files

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
    """Error against cost: time steps, integrators, solvers, precisions, laws of contact, MuJoCo and rapier, on your model or study.

    Or on a built-in scene whose right answer is known. Of a model, what is right is converged by the command itself, which says how well it
    is known; errors are split into what the solver, the time step and the model make of them. Beside them are invariants and distributions
    of outcomes, which mean something where motions are chaotic.

    Example: stepper chart robot.xml --horizon "0.5 s"
    """
    names = list(SCENES)
    if scene in (*names, "all"):
        if ray or budget or values:
            which = "--ray" if ray else "--budget" if budget else "--values"
            raise ValueError(
                f'"{scene}" is of the built-in scenes, which run in this process to their end; {which} is for models and studies'
            )
        with progress() as tick:
            pictures = charts(names if scene == "all" else [scene], out, Effort.quick() if quick else Effort(), tick)
        show_files([file for picture in pictures for file in (picture, picture.with_suffix(".csv"))])
        return
    if not Path(scene).exists():
        raise ValueError(f'there is no file and no scene "{scene}"; scenes are: {", ".join(names)}, all')
    with progress() as tick:
        source = of_source(scene, ray=ray, values=values)
        unit = "rad" if angle else "m"
        found = run(source, out, horizon=horizon, unit=unit, episodes=episodes, quick=quick, budget=budget, tick=tick)
    print(found.document.markdown())
    show_files(found.files)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    folder = typer.Option("out", "--out", help=OUT)
    over = typer.Option(False, "--ray", help=RAY_RUNS)
    chosen = typer.Option([], "--values", help=VALUES)

    @app.command("chart", help=chart.__doc__)
    def _(
        scene: str = typer.Argument("all", help="A model (MJCF, URDF, saved), a study (.toml, .py); or chain, box, all."),
        *,
        out: Path = folder,
        quick: bool = typer.Option(False, "--quick", help="Fewer repeats, settings and time steps, and two minutes at the most."),
        horizon: str | None = typer.Option(None, help='Time up to which errors count, "0.5 s"; without it, as far as the motion is known.'),
        angle: bool = typer.Option(False, "--angle", help="Errors are angles in rad, not distances in m."),
        episodes: int = typer.Option(8, min=1, help="Episodes, medians of which count."),
        budget: str | None = typer.Option(
            None, help='Time that it may take by the clock, "60 s"; what is not done then is stopped, and said.'
        ),
        values: list[str] = chosen,
        ray: bool = over,
    ) -> None:
        chart(scene, out, quick=quick, horizon=horizon, angle=angle, episodes=episodes, budget=budget, ray=ray, values=values)
