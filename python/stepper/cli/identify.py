"""Command `stepper identify`: identification of a model's parameters from measurements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from stepper._options import Options
from stepper.cli.options import Out
from stepper.loading import load
from stepper.shared.files import locked
from stepper.shared.progress import show_files, show_progress
from stepper.sysid import KINDS
from stepper.sysid import identify as run

KIND_HELP = (
    "Unknown parameter, a selector as in the example, with optional bounds low..high. Quote it for the shell. Repeat the option for more. "
    f"Fields: {', '.join(KINDS)}."
)


def identify(
    model: Annotated[str, typer.Argument(help="MJCF, URDF or a saved model.")],
    data: Annotated[list[Path], typer.Argument(help="Measurements: folders of recordings, .csv and .npz files.")],
    *,
    parameter: Annotated[list[str], typer.Option("--parameter", "-p", help=KIND_HELP)],
    out: Out = Path("out"),
    column: Annotated[
        list[str] | None,
        typer.Option(help='Channel of a column whose heading is not the channel\'s name, heading=channel: "Fx [N]=wrist_force[0]".'),
    ] = None,
    channel: Annotated[
        list[str] | None, typer.Option(help="Channel to use; without this option, all are used. Repeat the option for more.")
    ] = None,
    keyframe: Annotated[str | None, typer.Option(help="Keyframe of the initial state, for logs without the initial qpos and qvel.")] = None,
    starts: Annotated[int, typer.Option(min=1, help="Number of starting points of the search.")] = 4,
    contact: Annotated[str, typer.Option(help="Contact law: hard, or mujoco with the settings of the model's file.")] = "hard",
    timestep: Annotated[float | None, typer.Option(help="Time step, s; the default is that of the model.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the starting points.")] = 0,
) -> None:
    """Identifies parameters of a model from measurements: masses, friction, damping and more, each with a 95 % interval.

    The command also lists the parameters that the data do not determine.

    Example: stepper identify robot.xml push.csv -p 'body_mass[box]' -p 'geom_friction[floor,box][0]=0.05..2'
    """
    read = load(model)
    options = None  # Default options of `stepper.sysid.identify`.
    if contact == "mujoco":
        options = Options.from_model(read) if timestep is None else replace(Options.from_model(read), timestep=timestep)
    elif contact != "hard":
        raise ValueError(f"--contact is {contact!r}, must be hard or mujoco")
    elif timestep is not None:
        options = Options(timestep=timestep)
    settings: dict[str, Any] = {"options": options, "starts": starts, "seed": seed, "channels": channel or None}
    columns = dict(map(_pair, column or ()))
    with locked(out):
        with show_progress() as progress:
            found = run(read, data, parameter, start=keyframe, columns=columns, progress=progress, **settings)
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
