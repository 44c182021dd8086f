"""Command `stepper view`: view of a model, a study, a recording or environments in the browser."""

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
from stepper.cli.options import ARGUMENTS, VALUES, arguments_of, values_of
from stepper.lab.progress import show_progress
from stepper.lab.study import Study
from stepper.lab.study.episode import Episodes
from stepper.lab.study.journal import diverged
from stepper.lab.study.points import USUAL
from stepper.loading import ModelWarning, load
from stepper.recording.format import HEADER
from stepper.shared.environments import import_env
from stepper.shared.machine import require
from stepper.viewer import Player, View, log_rerun

if TYPE_CHECKING:
    from typer import Typer

ACTIONS = ("random", "zero")
STUDIES = (".toml", ".py")
MODELS = (".xml", ".urdf", ".mjb")
"""Suffixes that distinguish model files from ids of environments, such as stepper/dm_control.walker-walk-v0."""


class ViewOptions(NamedTuple):
    """Options of the command `stepper view` for all kinds of sources.

    Fields have the names of the options, with one exception: the field `looks` has the value of the option --model. This is a model file
    with the meshes and colours to show.
    """

    num_envs: int
    looks: Path | None
    contact: Literal["hard", "mujoco"] | None
    keyframe: str | None
    actions: str | None
    seed: int | None
    pause: bool
    host: str
    port: int


class StudyOptions(NamedTuple):
    """Options of the command `stepper view` that only apply to studies; fields have the names of the options."""

    values: tuple[str, ...]
    episode: int | None
    setting: str | None
    record: Path | None


def view(what: str, options: ViewOptions, of_study: StudyOptions, rerun: Path | None) -> None:
    """Shows a model, a study's episodes, a recording or environments in the browser, with contacts.

    Environments stand side by side, and the mouse can drag bodies.

    Examples: stepper view humanoid.xml --num-envs 9; stepper view run; stepper view stepper/HalfCheetah-v5 --num-envs 4;
    stepper view examples/studies/tray.toml --values friction=0.5 --values push=2.2
    """
    is_study = Path(what).suffix in STUDIES
    is_model = Path(what).exists() or Path(what).suffix in MODELS
    if not is_study:
        # Values are parameters of a study, or arguments of an environment.
        _refuse_study_options(what, of_study if is_model else of_study._replace(values=()))
    if (Path(what) / HEADER).exists():
        _refuse(what, "a recording", contact=options.contact, keyframe=options.keyframe, actions=options.actions, seed=options.seed)
        _play(Path(what), options, rerun)
        return
    if rerun is not None:
        raise ValueError(f"--rerun converts a recording, and {what} is not a recording: record one, or use stepper.viewer.RerunLog")
    if Path(what).is_dir():
        raise ValueError(f"{what} is a folder without {HEADER}, must be a recording, a model's file, or the id of an environment")
    if Path(what).suffix == ".npz" and Path(what).exists():
        raise ValueError(f"{what} is a policy, and runs in an environment: film it with stepper evaluate {what} ENVIRONMENT --film run.mp4")
    if is_study:
        _refuse(what, "a study", contact=options.contact, keyframe=options.keyframe, actions=options.actions)
        _study(what, options, of_study)
        return
    _refuse(what, "a model", actions=options.actions) if is_model else _refuse(what, "an environment", keyframe=options.keyframe)
    sim, advance, reset = _model(what, options) if is_model else _environments(what, options, arguments_of(of_study.values))
    opened = View(sim, envs=options.num_envs, source=options.looks, host=options.host, port=options.port, reset=reset)
    opened.paused = options.pause
    print(f"{opened.url} shows {what}; Ctrl-C ends it", flush=True)
    opened.run(advance)


def _study(file: str, options: ViewOptions, of_study: StudyOptions) -> None:
    """Shows the episodes of a study in the browser, or records them with the option --record. `file` is the study's path."""
    study = Study.from_file(file)
    study = study if options.seed is None else replace(study, seed=options.seed)
    values = values_of(of_study.values)
    first, setting = of_study.episode or 0, of_study.setting or USUAL
    episodes = Episodes(study, values, range(first, first + options.num_envs), setting)
    if of_study.record is not None:
        for number, row in enumerate(episodes.rows(of_study.record), first):
            print(f"episode {number}: {_result(study, row['outcomes'], lost=diverged(row))}")
        print(f"recorded them in {of_study.record}; show them: stepper view {of_study.record}")
        return
    running = episodes.repeated_steps()

    def begin() -> None:
        nonlocal running
        running = episodes.repeated_steps()
        next(running)

    def advance() -> None:
        """Advances the episodes by one step. After the last step, prints their results and pauses."""
        outcomes = next(running, None)
        if outcomes is None:
            return
        for place, env in enumerate(episodes.shown):
            own = {name: float(value[place]) for name, value in outcomes.items()}
            print(f"episode {episodes.episodes[env]}: {_result(study, own, lost=bool(episodes.world.diverged[env]))}", flush=True)
        opened.paused = True

    begin()
    opened = View(episodes.sim, envs=episodes.shown, source=options.looks, host=options.host, port=options.port, reset=begin)
    opened.paused = options.pause
    print(f"{opened.url} shows {episodes.note}; Ctrl-C ends it", flush=True)
    opened.run(advance)


def _result(study: Study, outcomes: dict[str, float], *, lost: bool) -> str:
    """Text of the result of an episode: outcomes and success, or that the episode diverged (`lost`)."""
    if lost:
        return "diverged, without outcomes"
    units = {outcome.name: outcome.unit for outcome in study.all_outcomes}
    text = ", ".join(f"{name} {value:.6g} {units[name]}".strip() for name, value in outcomes.items()) or "no outcomes"
    if (outcome := study.success_outcome) is None:
        return text
    return f"{text}: {'a success' if outcome.succeeds(np.array([outcomes[outcome.name]]))[0] else 'no success'}"


def _refuse_study_options(what: str, of_study: StudyOptions) -> None:
    """Raises ValueError if the user gave an option that only applies to studies. `what` is the source to show, for the message."""
    for name, value in of_study._asdict().items():
        if value not in (None, ()):
            kinds, is_none = (
                ("studies and environments", "neither") if name == "values" else (f"studies ({', '.join(STUDIES)})", "not a study")
            )
            raise ValueError(f"--{name} is for {kinds}, and {what} is {is_none}: leave it out")


def _refuse(what: str, kind: str, **given: object) -> None:
    """Raises ValueError if the user gave an option that has no effect on this kind of source.

    Args:
        what: Source to show: a path or the id of an environment.
        kind: Kind of the source, such as "a recording".
        **given: Values of the options without effect, by name; None for an option that the user did not give.
    """
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"--{name} has no effect on {kind}, and {what} is one: leave it out")


def _play(folder: Path, options: ViewOptions, rerun: Path | None) -> None:
    """Shows a recording in the browser, or converts it to a log for the viewer Rerun if the path `rerun` is not None."""
    # The default of 1 means all environments for a recording.
    envs = options.num_envs if options.num_envs > 1 else None
    if rerun is not None:
        with show_progress() as progress:
            frames = log_rerun(folder, rerun, envs=envs, source=options.looks, progress=progress)
        print(f"wrote {frames} frames to {rerun}; show them: rerun {rerun}")
        return
    player = Player(folder, envs=envs, source=options.looks, host=options.host, port=options.port)
    print(f"{player.url} plays {folder}; Ctrl-C ends it", flush=True)
    player.run()


Simulation = tuple[Stepper, "Callable[[], Any] | None", "Callable[[], Any]"]
"""Type of a simulation to show: a stepper, a function that advances it (None selects `Stepper.step`), and a function that resets it."""


def _model(file: str, options: ViewOptions) -> Simulation:
    """Simulation of a model file: stepper, step function and reset function."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # `stepper explain` lists the warnings.
        model = load(file, strict=False)
    of_step = Options.from_model(model) if options.contact == "mujoco" else Options()
    sim = Stepper(model, options.num_envs, options=of_step, seed=options.seed or 0)
    key = int(options.keyframe) if options.keyframe is not None and options.keyframe.isdigit() else options.keyframe

    def reset() -> None:
        sim.reset(keyframe=key)

    reset()
    return sim, None, reset


def _environments(name: str, options: ViewOptions, arguments: dict[str, Any]) -> Simulation:
    """Simulation of environments, made with `arguments` from an id in Gymnasium's registry: stepper, step function and reset function."""
    gymnasium = require("gymnasium", "to view an environment")
    importlib.import_module("stepper.envs")
    try:
        law = {} if options.contact is None else {"contact": options.contact}
        envs = gymnasium.make_vec(import_env(name), num_envs=options.num_envs, **law, **arguments)
    except gymnasium.error.Error as error:
        raise ValueError(f"{name} is neither a file nor a recording nor an environment: {error}") from error
    sim = getattr(envs.unwrapped, "sim", None)
    if not isinstance(sim, Stepper):
        raise ValueError(f"{name} is an environment of another simulator: use one on stepper, such as stepper/HalfCheetah-v5")
    envs.action_space.seed(options.seed or 0)
    envs.reset(seed=options.seed or 0)
    zero = np.zeros(envs.action_space.shape)

    def advance() -> None:
        envs.step(zero if options.actions == "zero" else envs.action_space.sample())

    return sim, advance, envs.reset


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `view` to the Typer application; `typer` is the module."""
    file = typer.Option(None, "--model", exists=True, help="MJCF file with the colours and meshes of a recording or a saved model.")
    parameters = typer.Option([], "--values", help=f"For a study: {VALUES} For an environment: {ARGUMENTS}")
    folder = typer.Option(None, help="New folder: record the study's episodes there, and open no view.")
    log = typer.Option(None, help="New .rrd file for Rerun: convert a recording to it, and open no view.")

    @app.command("view", help=view.__doc__)
    def _(
        what: str = typer.Argument(help="Model file, study file (.toml, .py), folder of a recording, or environment id."),
        *,
        num_envs: int = typer.Option(
            1, min=1, help="Number of environments or episodes to show; for a recording, 1 shows all of them, up to 16."
        ),
        model: Path | None = file,
        contact: str | None = typer.Option(None, help='Law of contact, "hard" or "mujoco"; the default is the environment\'s, or hard.'),
        keyframe: str | None = typer.Option(None, help="Keyframe of the model's initial state, by name or index."),
        actions: str | None = typer.Option(None, help='Actions of environments, "random" (default) or "zero".'),
        seed: int | None = typer.Option(None, min=0, help="Seed of random numbers; the default is that of the study, or 0."),
        values: list[str] = parameters,
        episode: int | None = typer.Option(None, min=0, help="Number of the study's first episode to show; the default is 0."),
        setting: str | None = typer.Option(None, help="Name of the study's settings to use."),
        record: Path | None = folder,
        pause: bool = typer.Option(False, "--pause", help="Start paused."),
        rerun: Path | None = log,
        host: str = typer.Option("127.0.0.1", help="Address to listen on; with 0.0.0.0 other machines can connect."),
        port: int = typer.Option(8080, min=1, max=65535, help="Port to listen on, or the next free one."),
    ) -> None:
        for name, given, words in (("contact", contact, (None, "hard", "mujoco")), ("actions", actions, (None, *ACTIONS))):
            if given not in words:
                raise ValueError(f"{name} is {given!r}, must be {' or '.join(repr(word) for word in words if word)}")
        options = ViewOptions(num_envs, model, cast("Any", contact), keyframe, actions, seed, pause, host, port)
        view(what, options, StudyOptions(tuple(values), episode, setting, record), rerun)
