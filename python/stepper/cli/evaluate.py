"""Command `stepper evaluate`: evaluation of a policy in one environment, or in two for comparison."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any

from stepper.cli.options import ARGUMENTS, arguments_of
from stepper.lab.progress import show_files, show_progress
from stepper.policies import check_film, compare, describe, differences, film, load
from stepper.policies import evaluate as run
from stepper.policies.evaluation import make
from stepper.policies.film import FILMED

if TYPE_CHECKING:
    from typer import Typer


def evaluate(
    policy: Path,
    env: str,
    against: str = "",
    *,
    episodes: int,
    seed: int,
    margin: float,
    settings: dict[str, Any],
    values: Mapping[str, Any] = MappingProxyType({}),
    infos: Sequence[str] = (),
    video: Path | None = None,
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
    if own := sorted(values.keys() & {"contact", "precision"}):
        raise ValueError(f"--values sets {own[0]}: use the option --{own[0]} instead")
    settings, shared = settings | dict(values), dict(values)
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
            found = str(run(loaded, env, episodes=episodes, seed=seed, infos=infos, progress=progress, **settings))
    print(found)
    if video is not None:
        with show_progress() as progress:
            film(loaded, env, video, actions=FILMED, seed=seed, progress=progress, **settings)
        show_files([video])


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command `evaluate` to the Typer application; `typer` is the module."""
    file = typer.Argument(help="Policy file, from stepper train or Policy.save.")
    keys = typer.Option(
        [], "--info", help="Key of an info whose mean and last value are printed, for example tracking_error. Repeat the option for more."
    )

    arguments = typer.Option([], "--values", help=ARGUMENTS)
    video = typer.Option(None, "--film", metavar="FILE", help=f"Video (mp4) of at most {FILMED} actions of the first episode.")

    @app.command("evaluate", help=evaluate.__doc__)
    def _(
        *,
        policy: Path = file,
        env: str = typer.Argument(help="Environment id, for example stepper/HalfCheetah-v5."),
        against: str = typer.Option("", help="Second environment id, for example HalfCheetah-v5, Gymnasium's environment on MuJoCo."),
        episodes: int = typer.Option(20, min=2, help="Number of episodes, at least 2: the interval of the mean needs their spread."),
        seed: int = typer.Option(0, min=0, help="Seed of the evaluation; each episode gets an independent seed."),
        margin: float = typer.Option(
            0.02, help="Largest difference of mean returns that counts as equivalent, as a fraction of the first mean return."
        ),
        infos: list[str] = keys,
        values: list[str] = arguments,
        video: Path | None = video,
        contact: str = typer.Option("", help='Contact law of the first environment, "mujoco" or "hard".'),
        precision: str = typer.Option("", help='Precision of the first environment, "f64" or "f32".'),
    ) -> None:
        settings = {name: value for name, value in (("contact", contact), ("precision", precision)) if value}
        given = {"settings": settings, "values": arguments_of(values)}
        evaluate(policy, env, against, episodes=episodes, seed=seed, margin=margin, infos=infos, video=video, **given)
