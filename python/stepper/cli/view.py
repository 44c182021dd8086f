"""`stepper view`."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.loading import ModelWarning, load
from stepper.recording.format import HEADER
from stepper.shared.machine import require
from stepper.viewer import Player, View, log_rerun

if TYPE_CHECKING:
    from typer import Typer

ACTIONS = ("random", "zero")
MODELS = (".xml", ".urdf", ".mjb")
"""Endings of models' files. Names of environments have points, too: stepper/dm_control.walker-walk-v0."""


class Asked(NamedTuple):
    """What the command was asked for; see its options."""

    envs: int
    looks: Path | None
    contact: Literal["hard", "mujoco"] | None
    keyframe: str | None
    actions: str | None
    seed: int
    pause: bool
    host: str
    port: int


def view(what: str, asked: Asked, rerun: Path | None) -> None:
    """Shows a model, a recording or environments in the browser: many side by side, with contacts and forces; bodies can be dragged.

    Examples: stepper view humanoid.xml --envs 9; stepper view run; stepper view stepper/HalfCheetah-v5 --envs 4
    """
    if (Path(what) / HEADER).exists():
        _refuse(what, "a recording", contact=asked.contact, keyframe=asked.keyframe, actions=asked.actions)
        _play(Path(what), asked, rerun)
        return
    if rerun is not None:
        raise ValueError(f"--rerun writes a recording, and {what} is none: record one, or use stepper.viewer.RerunLog")
    if Path(what).is_dir():
        raise ValueError(f"{what} is a folder without {HEADER}, must be a recording, a model's file, or the name of an environment")
    is_model = Path(what).exists() or Path(what).suffix in MODELS
    _refuse(what, "a model", actions=asked.actions) if is_model else _refuse(what, "an environment", keyframe=asked.keyframe)
    sim, advance, reset = _model(what, asked) if is_model else _environments(what, asked)
    opened = View(sim, envs=asked.envs, source=asked.looks, host=asked.host, port=asked.port, reset=reset)
    opened.paused = asked.pause
    print(f"{opened.url} shows {what}; Ctrl-C ends it", flush=True)
    opened.run(advance)


def _refuse(what: str, kind: str, **given: str | None) -> None:
    """Raises ValueError where an option was given that what is shown does not heed."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"--{name} says nothing of {kind}, and {what} is one: leave it out")


def _play(folder: Path, asked: Asked, rerun: Path | None) -> None:
    # One environment is what the command shows by default, and a recording has a number of its own.
    envs = asked.envs if asked.envs > 1 else None
    if rerun is not None:
        moments = log_rerun(folder, rerun, envs=envs, source=asked.looks)
        print(f"{rerun} has {moments} moments: rerun {rerun}")
        return
    player = Player(folder, envs=envs, source=asked.looks, host=asked.host, port=asked.port)
    print(f"{player.url} plays {folder}; Ctrl-C ends it", flush=True)
    player.run()


Shown = tuple[Stepper, "Callable[[], Any] | None", "Callable[[], Any]"]


def _model(file: str, asked: Asked) -> Shown:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # `stepper explain` says it.
        model = load(file, strict=False)
    sim = Stepper(model, asked.envs, options=Options.of(model) if asked.contact == "mujoco" else Options(), seed=asked.seed)
    key = int(asked.keyframe) if asked.keyframe is not None and asked.keyframe.isdigit() else asked.keyframe

    def reset() -> None:
        sim.reset(keyframe=key)

    reset()
    return sim, None, reset


def _environments(name: str, asked: Asked) -> Shown:
    gymnasium = require("gymnasium", "to view an environment")
    importlib.import_module("stepper.envs")
    try:
        law = {} if asked.contact is None else {"contact": asked.contact}
        envs = gymnasium.make_vec(name, num_envs=asked.envs, **law)
    except gymnasium.error.Error as error:
        raise ValueError(f"{name} is no file, no recording and no environment: {error}") from error
    sim = getattr(envs.unwrapped, "sim", None)
    if not isinstance(sim, Stepper):
        raise ValueError(f"{name} is an environment of another simulator: stepper.envs has such as stepper/HalfCheetah-v5")
    envs.action_space.seed(asked.seed)
    envs.reset(seed=asked.seed)
    zero = np.zeros(envs.action_space.shape)

    def advance() -> None:
        envs.step(zero if asked.actions == "zero" else envs.action_space.sample())

    return sim, advance, envs.reset


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    file = typer.Option(None, "--model", exists=True, help="MJCF of a recording or a saved model, for its colours and meshes.")
    log = typer.Option(None, help="A .rrd file for Rerun, which is written of a recording in place of the view.")

    @app.command("view", help=view.__doc__)
    def _(
        what: str = typer.Argument(help="A model's file, a folder that Stepper.record wrote, or the name of an environment."),
        *,
        envs: int = typer.Option(1, min=1, help="Environments side by side; of a recording the first so many, 1 for all up to 16."),
        model: Path | None = file,
        contact: str | None = typer.Option(None, help='Law of contact, "hard" or "mujoco"; without it, hard, or that of the environment.'),
        keyframe: str | None = typer.Option(None, help="Keyframe that a model starts from, by name or index."),
        actions: str | None = typer.Option(None, help='Actions of environments, "random" or "zero"; without it, random.'),
        seed: int = typer.Option(0, min=0, help="Of what is random."),
        pause: bool = typer.Option(False, "--pause", help="Begin with a simulation that waits."),
        rerun: Path | None = log,
        host: str = typer.Option("127.0.0.1", help="Address to listen at; 0.0.0.0 lets other machines see it."),
        port: int = typer.Option(8080, min=1, max=65535, help="Port; the next free one where it is taken."),
    ) -> None:
        for name, given, known in (("contact", contact, (None, "hard", "mujoco")), ("actions", actions, (None, *ACTIONS))):
            if given not in known:
                raise ValueError(f"{name} is {given!r}, must be {' or '.join(repr(word) for word in known if word)}")
        view(what, Asked(envs, model, cast("Any", contact), keyframe, actions, seed, pause, host, port), rerun)
