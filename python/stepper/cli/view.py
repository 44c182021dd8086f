"""Command `stepper view`: view of a model, a study, a recording or environments in the browser."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.cli.options import ARGUMENTS, VALUES, Data, arguments_of, values_of
from stepper.lab.study import Study
from stepper.lab.study.batches import USUAL
from stepper.lab.study.episode import Episodes
from stepper.lab.study.journal import diverged
from stepper.loading import ModelWarning, load
from stepper.recording.format import HEADER
from stepper.shared.environments import import_env
from stepper.shared.machine import require
from stepper.viewer import Player, View

ACTIONS = ("random", "zero")
STUDIES = (".toml", ".py")
MODELS = (".xml", ".urdf", ".mjb")
"""Suffixes that distinguish model files from ids of environments, such as stepper/dm_control.walker-walk-v0."""


@dataclass(frozen=True)
class ViewOptions:
    """Options of the command `stepper view`, by their names. The field `model` is a model file with the meshes and colours to show."""

    num_envs: int
    model: Path | None
    contact: str | None
    keyframe: str | None
    actions: str | None
    seed: int | None
    values: list[str] | None
    episode: int | None
    setting: str | None
    record: Path | None
    data: Path | None
    pause: bool
    host: str
    port: int


_OPTIONAL = ("contact", "keyframe", "actions", "seed", "values", "episode", "setting", "record", "data")
"""Options that not all kinds of sources take; None if the user does not give them."""
_TAKEN = {
    "a recording": (),
    "a study": ("seed", "values", "episode", "setting", "record", "data"),
    "a model": ("contact", "keyframe", "seed"),
    "an environment": ("contact", "actions", "seed", "values"),
}
"""Options among `_OPTIONAL` that each kind of source takes."""


def view(
    what: Annotated[str, typer.Argument(help="Model file, study file (.toml, .py), folder of a recording, or environment id.")],
    *,
    num_envs: Annotated[
        int, typer.Option(min=1, help="Number of environments or episodes to show; for a recording, 1 shows all of them, up to 16.")
    ] = 1,
    model: Annotated[
        Path | None, typer.Option(exists=True, help="MJCF file with the colours and meshes of a recording or a saved model.")
    ] = None,
    contact: Annotated[
        str | None, typer.Option(help='Law of contact, "hard" or "mujoco"; the default is the environment\'s, or hard.')
    ] = None,
    keyframe: Annotated[str | None, typer.Option(help="Keyframe of the model's initial state, by name or index.")] = None,
    actions: Annotated[str | None, typer.Option(help='Actions of environments, "random" (default) or "zero".')] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of random numbers; the default is that of the study, or 0.")] = None,
    values: Annotated[list[str] | None, typer.Option(help=f"For a study: {VALUES} For an environment: {ARGUMENTS}")] = None,
    episode: Annotated[int | None, typer.Option(min=0, help="Number of the study's first episode to show; the default is 0.")] = None,
    setting: Annotated[str | None, typer.Option(help="Name of the study's settings to use.")] = None,
    record: Annotated[Path | None, typer.Option(help="New folder: record the study's episodes there, and open no view.")] = None,
    data: Data = None,
    pause: Annotated[bool, typer.Option("--pause", help="Start paused.")] = False,
    host: Annotated[str, typer.Option(help="Address to listen on; with 0.0.0.0 other machines can connect.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on, or the next free one.")] = 8080,
) -> None:
    """Shows a model, a study's episodes, a recording or environments in the browser, with contacts.

    Environments stand side by side, and the mouse can drag bodies.

    Examples: stepper view humanoid.xml --num-envs 9; stepper view run; stepper view stepper/HalfCheetah-v5 --num-envs 4;
    stepper view examples/studies/tray.toml --values friction=0.5 --values push=2.2
    """
    for name, given, words in (("contact", contact, ("hard", "mujoco")), ("actions", actions, ACTIONS)):
        if given is not None and given not in words:
            raise ValueError(f"{name} is {given!r}, must be {' or '.join(map(repr, words))}")
    options = ViewOptions(
        num_envs, model, contact, keyframe, actions, seed, values or None, episode, setting, record, data, pause, host, port
    )
    path = Path(what)
    is_recording, is_study = (path / HEADER).exists(), path.suffix in STUDIES
    is_model = path.exists() or path.suffix in MODELS
    kind = "a recording" if is_recording else "a study" if is_study else "a model" if is_model else "an environment"
    for name in _OPTIONAL:
        if getattr(options, name) is not None and name not in _TAKEN[kind]:
            raise ValueError(f"--{name} has no effect on {kind}, and {what} is one: leave it out")
    if path.is_dir() and not is_recording:
        raise ValueError(f"{what} is a folder without {HEADER}, must be a recording, a model's file, or the id of an environment")
    if path.suffix == ".npz" and path.exists():
        raise ValueError(f"{what} is a policy, and runs in an environment: film it with stepper evaluate {what} ENVIRONMENT --film run.mp4")
    if is_recording:
        _play(path, options)
    elif is_study:
        _study(what, options)
    else:
        sim, advance, reset = _model(what, options) if is_model else _environments(what, options)
        opened = View(sim, envs=num_envs, source=model, host=host, port=port, reset=reset)
        opened.paused = pause
        print(f"{opened.url} shows {what}; Ctrl-C ends it", flush=True)
        opened.run(advance)


def _study(file: str, options: ViewOptions) -> None:
    """Shows the episodes of a study in the browser, or records them with the option --record. `file` is the study's path."""
    study = Study.from_file(file, options.data)
    study = study if options.seed is None else replace(study, seed=options.seed)
    values = values_of(options.values or ())
    first, setting = options.episode or 0, options.setting or USUAL
    episodes = Episodes(study, values, range(first, first + options.num_envs), setting)
    if options.record is not None:
        for number, row in enumerate(episodes.rows(options.record), first):
            print(f"episode {number}: {_result(study, row['outcomes'], lost=diverged(row))}")
        print(f"recorded them in {options.record}; show them: stepper view {options.record}")
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
    opened = View(episodes.sim, envs=episodes.shown, source=options.model, host=options.host, port=options.port, reset=begin)
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


def _play(folder: Path, options: ViewOptions) -> None:
    """Shows a recording in the browser."""
    # The default of 1 means all environments for a recording.
    envs = options.num_envs if options.num_envs > 1 else None
    player = Player(folder, envs=envs, source=options.model, host=options.host, port=options.port)
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


def _environments(name: str, options: ViewOptions) -> Simulation:
    """Simulation of environments with an id in Gymnasium's registry: stepper, step function and reset function."""
    gymnasium = require("gymnasium", "to view an environment")
    importlib.import_module("stepper.envs")
    try:
        law = {} if options.contact is None else {"contact": options.contact}
        envs = gymnasium.make_vec(import_env(name), num_envs=options.num_envs, **law, **arguments_of(options.values or ()))
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
