"""Command `stepper evaluate`: evaluation of a policy in one environment, or in two for comparison."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stepper.cli.options import Arguments, arguments_of
from stepper.policies import check_film, compare, describe, differences, film, load
from stepper.policies import evaluate as run
from stepper.policies.evaluation import make
from stepper.policies.film import FILMED
from stepper.shared.progress import show_files, show_progress


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
    loaded = load(policy)
    if video is not None:
        check_film(env, video, **settings)
    for name, given in ((env, settings), (against, shared)):
        if name:
            for line in differences(loaded.environment, describe(make(name, **given))):
                print(f"{name}: {line}", file=sys.stderr)
    with show_progress() as progress:
        if against:
            both = compare(
                loaded, env, against, episodes=episodes, seed=seed, margin=margin, settings=(settings, shared), progress=progress
            )
            found = "\n".join(map(str, (both.one, both.other, both)))
        else:
            found = str(run(loaded, env, episodes=episodes, seed=seed, infos=infos or (), progress=progress, **settings))
    print(found)
    if video is not None:
        with show_progress() as progress:
            film(loaded, env, video, actions=FILMED, seed=seed, progress=progress, **settings)
        show_files([video])
