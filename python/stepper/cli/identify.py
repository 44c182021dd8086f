"""Command `stepper identify`: identification of a model's parameters from measurements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from stepper._options import Options
from stepper.cli.options import OUT
from stepper.lab.progress import show_files, show_progress
from stepper.loading import load
from stepper.shared.files import locked
from stepper.sysid import KINDS
from stepper.sysid import identify as run

if TYPE_CHECKING:
    from typer import Typer

KIND_HELP = (
    "Unknown parameter, a selector as in the example, with optional bounds low..high. Quote it for the shell. Repeat the option for more. "
    f"Fields: {', '.join(KINDS)}."
)


def identify(
    model: str,
    data: list[Path],
    parameters: list[str],
    out: Path,
    *,
    columns: list[str],
    channels: list[str],
    keyframe: str | None,
    loss: str,
    starts: int,
    law: str,
    timestep: float | None,
    seed: int,
) -> None:
    """Identifies parameters of a model from measurements: masses, friction, damping and more, each with a 95 % interval.

    The command also lists the parameters that the data do not determine.

    Example: stepper identify robot.xml push.csv -p 'body_mass[box]' -p 'geom_friction[floor,box][0]=0.05..2'
    """
    read = load(model)
    options = None  # Default options of `stepper.sysid.identify`.
    if law == "mujoco":
        options = Options.from_model(read) if timestep is None else replace(Options.from_model(read), timestep=timestep)
    elif law != "hard":
        raise ValueError(f"--contact is {law!r}, must be hard or mujoco")
    elif timestep is not None:
        options = Options(timestep=timestep)
    pairs = dict(_pair(column) for column in columns)
    settings: dict[str, Any] = {
        "options": options,
        "loss": loss,
        "starts": starts,
        "seed": seed,
        "columns": pairs,
        "channels": channels or None,
    }
    with locked(out):
        with show_progress() as progress:
            found = run(read, list(data), parameters, start=keyframe, progress=progress, **settings)
        print(found)
        found.save(out / "identified.json")
        found.estimate.save(out / "identified.stepper")
    show_files([out / "identified.json", out / "identified.stepper"])


def _pair(text: str) -> tuple[str, str]:
    """Heading of a data column and name of its channel, from a text heading=channel of the option --column."""
    name, equals, channel = text.rpartition("=")
    if not equals or not name:
        raise ValueError(f'--column is "{text}", must be heading=channel, as in "Fx [N]=wrist_force[0]"')
    return name, channel


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `identify` to the Typer application; `typer` is the module."""
    folder = typer.Option("out", "--out", help=OUT)
    files = typer.Argument(help="Measurements: folders of recordings, .csv and .npz files.")
    unknowns = typer.Option(..., "--parameter", "-p", help=KIND_HELP)
    renamed = typer.Option(
        [], "--column", help='Channel of a column whose heading is not the channel\'s name, heading=channel: "Fx [N]=wrist_force[0]".'
    )
    used = typer.Option([], "--channel", help="Channel to use; without this option, all are used. Repeat the option for more.")

    @app.command("identify", help=identify.__doc__)
    def _(  # noqa: PLR0917
        model: str = typer.Argument(help="MJCF, URDF or a saved model."),
        data: list[Path] = files,
        parameter: list[str] = unknowns,
        out: Path = folder,
        column: list[str] = renamed,
        channel: list[str] = used,
        keyframe: str | None = typer.Option(None, help="Keyframe of the initial state, for logs without the initial qpos and qvel."),
        loss: str = typer.Option("linear", help="Loss function, as in SciPy: linear, soft_l1, huber, cauchy or arctan."),
        starts: int = typer.Option(4, min=1, help="Number of starting points of the search."),
        contact: str = typer.Option("hard", help="Contact law: hard, or mujoco with the settings of the model's file."),
        timestep: float | None = typer.Option(None, help="Time step, s; the default is that of the model."),
        seed: int = typer.Option(0, help="Seed of the starting points."),
    ) -> None:
        identify(
            model, data, parameter, out, columns=column, channels=channel, keyframe=keyframe, loss=loss, starts=starts, law=contact,
            timestep=timestep, seed=seed,
        )  # fmt: skip
