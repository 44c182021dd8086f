"""`stepper identify`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from stepper._options import Options
from stepper.cli.options import OUT
from stepper.lab.progress import progress, show_files
from stepper.loading import load
from stepper.sysid import KINDS
from stepper.sysid import identify as run

if TYPE_CHECKING:
    from typer import Typer

KIND_HELP = (
    f"field[name,name][column]=low..high, without bounds too, of the kinds {', '.join(KINDS)}. Quote it for the shell. Give several."
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
    """Masses, friction, damping and more from what was measured, each with a 95 % interval, and what the data do not say.

    Example: stepper identify robot.xml push.csv -p 'body_mass[box]' -p 'geom_friction[floor,box][0]=0.05..2'
    """
    read = load(model)
    # As of `stepper.sysid.identify`, unless something else is asked for.
    options = None
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
    with progress() as tick:
        found = run(read, list(data), parameters, start=keyframe, tick=tick, **settings)
    print(found)
    out.mkdir(parents=True, exist_ok=True)
    found.save(out / "identified.json")
    found.estimate.save(out / "identified.stepper")
    show_files([out / "identified.json", out / "identified.stepper"])


def _pair(text: str) -> tuple[str, str]:
    name, equals, channel = text.rpartition("=")
    if not equals or not name:
        raise ValueError(f'--column is "{text}", must be heading=channel, as in "Fx [N]=wrist_force[0]"')
    return name, channel


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    folder = typer.Option("out", "--out", help=OUT)
    files = typer.Argument(help="Recordings, .csv and .npz files.")
    wanted = typer.Option(..., "--parameter", "-p", help=KIND_HELP)
    renamed = typer.Option([], "--column", help='What a column of the file is here: "Fx [N]=wrist_force[0]".')
    used = typer.Option([], "--channel", help="Channels to use; all without it.")

    @app.command("identify", help=identify.__doc__)
    def _(  # noqa: PLR0917
        model: str = typer.Argument(help="MJCF, URDF or a saved model."),
        data: list[Path] = files,
        parameter: list[str] = wanted,
        out: Path = folder,
        column: list[str] = renamed,
        channel: list[str] = used,
        keyframe: str | None = typer.Option(None, help="Where logs begin that do not say it."),
        loss: str = typer.Option("linear", help="linear, soft_l1, huber, cauchy or arctan: how outliers count."),
        starts: int = typer.Option(4, min=1, help="Searches side by side."),
        contact: str = typer.Option("hard", help="hard, or mujoco for MuJoCo's law as the file asks for it."),
        timestep: float | None = typer.Option(None, help="Time step, s; the model's own without it."),
        seed: int = typer.Option(0, help="Of what is random."),
    ) -> None:
        identify(
            model, data, parameter, out, columns=column, channels=channel, keyframe=keyframe, loss=loss, starts=starts, law=contact,
            timestep=timestep, seed=seed,
        )  # fmt: skip
