"""Commands `stepper demo`, `train`, `evaluate`, `identify`, `replay` and `doctor`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from stepper import policies, sysid
from stepper._options import Options
from stepper.cli.options import RECORDING, Arguments, Out, arguments_of
from stepper.doctor import diagnose
from stepper.lab.demo import Plan, demo as run_demo
from stepper.loading import load
from stepper.policies import ppo_settings
from stepper.policies.evaluation import FILMED
from stepper.recording import verify
from stepper.shared.files import locked
from stepper.shared.progress import show_files, show_progress

KIND_HELP = (
    "Unknown parameter, a selector as in the example, with optional bounds low..high. Quote it for the shell. Repeat the option for more. "
    f"Fields: {', '.join(sysid.KINDS)}."
)


def demo(
    num_envs: Annotated[int, typer.Option(min=1, help="Number of humanoids.")] = 1024,
    steps: Annotated[int, typer.Option(min=1, help="Number of steps with random controls.")] = 500,
    rest: Annotated[int, typer.Option(min=0, help="Number of steps without controls after them.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random controls.")] = 0,
    out: Out = Path("out"),
) -> None:
    """Compares stepper with MuJoCo on a thousand humanoids that fall and come to rest: speed and errors."""
    run_demo(Plan(num_envs=num_envs, steps=steps, rest=rest, seed=seed), out)


def train(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ENV] [OPTIONS]", help="Environment, stepper/HalfCheetah-v5 by default, and options of the learner; --help lists them."
        ),
    ] = None,
) -> None:
    """Trains a policy by proximal policy optimisation (PPO) in PyTorch, evaluates it, and films it with --film.

    Every setting of the learner is an option; --help lists them. --values NAME=VALUE sets an argument of the environment, such as a field
    of its task. Files are written to a folder of out/train in the working folder, or to --out. The same command continues a stopped run.
    To change the learner, copy its source with --copy, change the copy, and run that.

    Example: stepper train stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

    Example: stepper train my_task:me/Push-v0 --steps 3000000 --num-envs 512

    Example: stepper train stepper/Go1Velocity-v0 --values roughness=0.05

    Example: stepper train --copy my_ppo.py
    """
    # The learner parses all arguments, so that a copy of it has the same options.
    words = arguments or []
    # Help, wrong options and --copy work without PyTorch, which takes seconds to import.
    given = ppo_settings.arguments("stepper train").parse_args(words)
    if given.copy is not None:
        ppo_settings.copy_learner(Path(ppo_settings.__file__).with_name("ppo.py"), given.copy)
        return
    print("stepper train: importing PyTorch", flush=True)
    from stepper.policies.ppo import main  # noqa: PLC0415

    main(words, "stepper train")


def evaluate(
    policy: Annotated[Path, typer.Argument(help="Policy file, from stepper train or Policy.save.")],
    env: Annotated[str, typer.Argument(help="Environment id, for example stepper/HalfCheetah-v5.")],
    *,
    against: Annotated[
        str, typer.Option(help="Second environment id, for example HalfCheetah-v5, Gymnasium's environment on MuJoCo.")
    ] = "",
    episodes: Annotated[int, typer.Option(min=2, help="Number of episodes, at least 2: the interval of the mean needs their spread.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the evaluation; each episode gets an independent seed.")] = 0,
    margin: Annotated[
        float, typer.Option(help="Largest difference of mean returns that counts as equivalent, as a fraction of the first mean return.")
    ] = 0.02,
    infos: Annotated[
        list[str] | None,
        typer.Option(
            "--info",
            help="Key of an info whose mean and last value are printed, for example tracking_error. Repeat the option for more.",
        ),
    ] = None,
    values: Arguments = None,
    video: Annotated[
        Path | None,
        typer.Option("--film", metavar="FILE", help=f"Video (mp4) of at most {FILMED} actions of the first episode."),
    ] = None,
    contact: Annotated[str, typer.Option(help='Contact law of the first environment, "mujoco" or "hard".')] = "",
    precision: Annotated[str, typer.Option(help='Precision of the first environment, "f64" or "f32".')] = "",
) -> None:
    """Evaluates a policy: prints its mean return with a confidence interval.

    The command first lists the differences between this environment and the environment in which the policy was trained. With --against,
    the policy also runs in a second environment from the same initial states. The command then tests whether the mean returns are
    equivalent. The option --values sets arguments of both environments. With --info, the command also prints the mean of an entry of the
    info dict. With --film, the command also films an episode.

    Example: stepper evaluate half_cheetah.npz stepper/HalfCheetah-v5 --film half_cheetah.mp4

    Example: stepper evaluate half_cheetah.npz stepper/HalfCheetah-v5 --against HalfCheetah-v5

    Example: stepper evaluate go1_velocity.npz stepper/Go1Velocity-v0 --info tracking_error --episodes 200 --values roughness=0.05
    """
    if against and infos:
        raise ValueError("--info cannot be compared: leave out --against or --info")
    shared = arguments_of(values or ())
    if own := sorted(shared.keys() & {"contact", "precision"}):
        raise ValueError(f"--values sets {own[0]}: use the option --{own[0]} instead")
    settings = shared | {name: value for name, value in (("contact", contact), ("precision", precision)) if value}
    loaded = policies.load(policy)
    if video is not None:
        policies.check_film(env, video, **settings)
    for name, given in ((env, settings), (against, shared)):
        if name:
            for line in policies.differences(loaded.environment, policies.describe(policies.make(name, **given))):
                print(f"{name}: {line}", file=sys.stderr)
    with show_progress() as progress:
        if against:
            both = policies.compare(
                loaded, env, against, episodes=episodes, seed=seed, margin=margin, settings=(settings, shared), progress=progress
            )
            found = "\n".join(map(str, (both.one, both.other, both)))
        else:
            found = str(policies.evaluate(loaded, env, episodes=episodes, seed=seed, infos=infos or (), progress=progress, **settings))
    print(found)
    if video is not None:
        with show_progress() as progress:
            policies.film(loaded, env, video, actions=FILMED, seed=seed, progress=progress, **settings)
        show_files([video])


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
            found = sysid.identify(read, data, parameter, start=keyframe, columns=columns, progress=progress, **settings)
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


def replay(
    recording: Annotated[Path, typer.Argument(help=RECORDING)],
    threads: Annotated[int | None, typer.Option(min=0, help="Number of threads; the default is that of the recording.")] = None,
) -> None:
    """Repeats a recording and compares the results bit for bit. Prints the first step and field that differ."""
    with show_progress() as progress:
        result = verify(recording, threads=threads, progress=progress)
    print(result)
    if not result:
        sys.exit(1)


def doctor() -> None:
    """Checks this installation: versions, CPU level, optional packages, and whether a short trajectory is identical bit for bit.

    The exit code is 1 if the trajectory differs, the self-test fails, two versions of MuJoCo are mixed, or the level STEPPER_CPU_LEVEL is
    not available. `python -m stepper.doctor` does the same without the packages of the command line.

    Example: stepper doctor
    """
    found = diagnose()
    print(found)
    if not found:
        sys.exit(1)
