"""`stepper evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from stepper.lab.progress import progress
from stepper.policies import compare, describe, differences, load
from stepper.policies import evaluate as run
from stepper.policies.evaluation import make

if TYPE_CHECKING:
    from typer import Typer


def evaluate(
    policy: Path, env: str, against: str, *, episodes: int, seed: int, margin: float, settings: dict[str, Any], infos: Sequence[str] = ()
) -> None:
    """Returns of a policy over fresh episodes, with a confidence interval; what differs from where it was trained is named first.

    With --against, the same policy from the same starts in a second environment, and whether the mean returns are equivalent.
    With --info, means of an info too.

    Example: stepper evaluate half_cheetah.npz stepper/HalfCheetah-v5 --against HalfCheetah-v5

    Example: stepper evaluate go1_velocity.npz stepper/Go1Velocity-v0 --info tracking_error --episodes 200
    """
    if against and infos:
        raise ValueError("--info has no comparison: leave out --against")
    loaded = load(policy)
    for name, given in ((env, settings), (against, {})):
        if name:
            for line in differences(loaded.environment, describe(make(name, **given))):
                print(f"{name}: {line}", file=sys.stderr)
    with progress() as tick:
        if against:
            both = compare(loaded, env, against, episodes=episodes, seed=seed, margin=margin, settings=(settings, {}), tick=tick)
            found = "\n".join(map(str, (both.one, both.other, both)))
        else:
            found = str(run(loaded, env, episodes=episodes, seed=seed, infos=infos, tick=tick, **settings))
    print(found)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    file = typer.Argument(help="A file of Policy.save, which stepper train writes.")
    asked = typer.Option([], "--info", help="An info whose mean is asked for too, tracking_error say; may be given several times.")

    @app.command("evaluate", help=evaluate.__doc__)
    def _(
        *,
        policy: Path = file,
        env: str = typer.Argument(help="An environment by its name, stepper/HalfCheetah-v5 say."),
        against: str = typer.Option("", help="A second environment, HalfCheetah-v5 say, Gymnasium's own on MuJoCo."),
        episodes: int = typer.Option(20, min=2, help="Fresh episodes."),
        seed: int = typer.Option(0, min=0, help="Of the first episode; the others have those that follow."),
        margin: float = typer.Option(0.02, help="Difference of mean returns that counts as none, as a fraction."),
        infos: list[str] = asked,
        contact: str = typer.Option("", help='Law of contact of the first environment, "mujoco" or "hard".'),
        precision: str = typer.Option("", help='Scalar type of its steps, "f64" or "f32".'),
    ) -> None:
        settings = {name: value for name, value in (("contact", contact), ("precision", precision)) if value}
        evaluate(policy, env, against, episodes=episodes, seed=seed, margin=margin, infos=infos, settings=settings)
