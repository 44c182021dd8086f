"""`stepper view`."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.cli.options import VALUES, value_of
from stepper.lab.progress import progress
from stepper.lab.study import Study
from stepper.lab.study.episode import Episodes
from stepper.lab.study.journal import diverged
from stepper.lab.study.points import USUAL
from stepper.loading import ModelWarning, load
from stepper.recording.format import HEADER
from stepper.shared.environments import known
from stepper.shared.machine import require
from stepper.viewer import Player, View, log_rerun

if TYPE_CHECKING:
    from typer import Typer

ACTIONS = ("random", "zero")
STUDIES = (".toml", ".py")
MODELS = (".xml", ".urdf", ".mjb")
"""Endings of models' files. Names of environments have points, too: stepper/dm_control.walker-walk-v0."""


class Asked(NamedTuple):
    """What the command was asked for; see its options."""

    envs: int
    looks: Path | None
    contact: Literal["hard", "mujoco"] | None
    keyframe: str | None
    actions: str | None
    seed: int | None
    pause: bool
    host: str
    port: int


class AskedOfStudy(NamedTuple):
    """Which episode of a study; see the options."""

    values: tuple[str, ...]
    episode: int | None
    setting: str | None
    record: Path | None


def view(what: str, asked: Asked, episode: AskedOfStudy, rerun: Path | None) -> None:
    """Shows a model, a study's episodes, a recording or environments in the browser: side by side, with contacts; bodies can be dragged.

    Examples: stepper view humanoid.xml --envs 9; stepper view run; stepper view stepper/HalfCheetah-v5 --envs 4;
    stepper view examples/studies/tray.toml --values friction=0.5 --values push=2.2
    """
    is_study = Path(what).suffix in STUDIES
    if not is_study:
        _refuse_of_study(what, episode)
    if (Path(what) / HEADER).exists():
        _refuse(what, "a recording", contact=asked.contact, keyframe=asked.keyframe, actions=asked.actions, seed=asked.seed)
        _play(Path(what), asked, rerun)
        return
    if rerun is not None:
        raise ValueError(f"--rerun writes a recording, and {what} is none: record one, or use stepper.viewer.RerunLog")
    if Path(what).is_dir():
        raise ValueError(f"{what} is a folder without {HEADER}, must be a recording, a model's file, or the name of an environment")
    if is_study:
        _refuse(what, "a study", contact=asked.contact, keyframe=asked.keyframe, actions=asked.actions)
        _study(what, asked, episode)
        return
    is_model = Path(what).exists() or Path(what).suffix in MODELS
    _refuse(what, "a model", actions=asked.actions) if is_model else _refuse(what, "an environment", keyframe=asked.keyframe)
    sim, advance, reset = _model(what, asked) if is_model else _environments(what, asked)
    opened = View(sim, envs=asked.envs, source=asked.looks, host=asked.host, port=asked.port, reset=reset)
    opened.paused = asked.pause
    print(f"{opened.url} shows {what}; Ctrl-C ends it", flush=True)
    opened.run(advance)


def _study(file: str, asked: Asked, wanted: AskedOfStudy) -> None:
    study = Study.from_file(file)
    study = study if asked.seed is None else replace(study, seed=asked.seed)
    values = {name: value for name, value in map(value_of, wanted.values)}
    first, setting = wanted.episode or 0, wanted.setting or USUAL
    episodes = Episodes(study, values, range(first, first + asked.envs), setting)
    if wanted.record is not None:
        for number, row in enumerate(episodes.rows(wanted.record), first):
            print(f"episode {number}: {_told(study, row['outcomes'], lost=diverged(row))}")
        print(f"{wanted.record} is a recording of them: stepper view {wanted.record}")
        return
    running = episodes.watched()

    def begin() -> None:
        nonlocal running
        running = episodes.watched()
        next(running)

    def advance() -> None:
        outcomes = next(running, None)
        if outcomes is None:
            return
        for place, env in enumerate(episodes.asked):
            own = {name: float(value[place]) for name, value in outcomes.items()}
            print(f"episode {episodes.episodes[env]}: {_told(study, own, lost=bool(episodes.world.diverged[env]))}", flush=True)
        opened.paused = True

    begin()
    opened = View(episodes.sim, envs=episodes.asked, source=asked.looks, host=asked.host, port=asked.port, reset=begin)
    opened.paused = asked.pause
    print(f"{opened.url} shows {episodes.note}; Ctrl-C ends it", flush=True)
    opened.run(advance)


def _told(study: Study, outcomes: dict[str, float], *, lost: bool) -> str:
    """Outcomes in words, and whether they are a success; or that the episode diverged."""
    if lost:
        return "it diverged, and has no outcome"
    units = {outcome.name: outcome.unit for outcome in study.all_outcomes}
    told = ", ".join(f"{name} {value:.6g} {units[name]}".strip() for name, value in outcomes.items()) or "no outcomes"
    if (decisive := study.decisive) is None:
        return told
    return f"{told}: {'a success' if decisive.succeeds(np.array([outcomes[decisive.name]]))[0] else 'no success'}"


def _refuse_of_study(what: str, asked: AskedOfStudy) -> None:
    """Raises ValueError where something was asked for that only a study has."""
    for name, value in asked._asdict().items():
        if value not in (None, ()):
            raise ValueError(f"--{name} is of studies ({', '.join(STUDIES)}), and {what} is none: leave it out")


def _refuse(what: str, kind: str, **given: object) -> None:
    """Raises ValueError where an option was given that what is shown does not heed."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"--{name} says nothing of {kind}, and {what} is one: leave it out")


def _play(folder: Path, asked: Asked, rerun: Path | None) -> None:
    # One environment is what the command shows by default, and a recording has a number of its own.
    envs = asked.envs if asked.envs > 1 else None
    if rerun is not None:
        with progress() as tick:
            moments = log_rerun(folder, rerun, envs=envs, source=asked.looks, tick=tick)
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
    sim = Stepper(model, asked.envs, options=Options.from_model(model) if asked.contact == "mujoco" else Options(), seed=asked.seed or 0)
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
        envs = gymnasium.make_vec(known(name), num_envs=asked.envs, **law)
    except gymnasium.error.Error as error:
        raise ValueError(f"{name} is no file, no recording and no environment: {error}") from error
    sim = getattr(envs.unwrapped, "sim", None)
    if not isinstance(sim, Stepper):
        raise ValueError(f"{name} is an environment of another simulator: stepper.envs has such as stepper/HalfCheetah-v5")
    envs.action_space.seed(asked.seed or 0)
    envs.reset(seed=asked.seed or 0)
    zero = np.zeros(envs.action_space.shape)

    def advance() -> None:
        envs.step(zero if asked.actions == "zero" else envs.action_space.sample())

    return sim, advance, envs.reset


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    file = typer.Option(None, "--model", exists=True, help="MJCF of a recording or a saved model, for its colours and meshes.")
    parameters = typer.Option([], "--values", help=VALUES)
    folder = typer.Option(None, help="A new folder for a recording of the study's episodes, which is made in place of the view.")
    log = typer.Option(None, help="A .rrd file for Rerun, which is written of a recording in place of the view.")

    @app.command("view", help=view.__doc__)
    def _(
        what: str = typer.Argument(help="A model's file, a study's (.toml, .py), a recording's folder, or the name of an environment."),
        *,
        envs: int = typer.Option(
            1, min=1, help="Environments or episodes side by side; of a recording the first so many, 1 for all up to 16."
        ),
        model: Path | None = file,
        contact: str | None = typer.Option(None, help='Law of contact, "hard" or "mujoco"; without it, hard, or that of the environment.'),
        keyframe: str | None = typer.Option(None, help="Keyframe that a model starts from, by name or index."),
        actions: str | None = typer.Option(None, help='Actions of environments, "random" or "zero"; without it, random.'),
        seed: int | None = typer.Option(None, min=0, help="Of what is random; without it 0, or that of the study."),
        values: list[str] = parameters,
        episode: int | None = typer.Option(None, min=0, help="Number of a study's episode, 0 without it."),
        setting: str | None = typer.Option(None, help="Name of a study's settings."),
        record: Path | None = folder,
        pause: bool = typer.Option(False, "--pause", help="Begin with a simulation that waits."),
        rerun: Path | None = log,
        host: str = typer.Option("127.0.0.1", help="Address to listen at; 0.0.0.0 lets other machines see it."),
        port: int = typer.Option(8080, min=1, max=65535, help="Port; the next free one where it is taken."),
    ) -> None:
        for name, given, words in (("contact", contact, (None, "hard", "mujoco")), ("actions", actions, (None, *ACTIONS))):
            if given not in words:
                raise ValueError(f"{name} is {given!r}, must be {' or '.join(repr(word) for word in words if word)}")
        asked = Asked(envs, model, cast("Any", contact), keyframe, actions, seed, pause, host, port)
        view(what, asked, AskedOfStudy(tuple(values), episode, setting, record), rerun)
