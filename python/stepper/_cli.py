"""The command line: `stepper demo`, `stepper chart`, `stepper explain`, `stepper report`, `stepper replay`."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepper._stepper import ModelError
from stepper.shared.machine import require

if TYPE_CHECKING:
    from typer import Typer


def demo(num_envs: int, steps: int, rest: int, seed: int, out: Path) -> None:
    """A thousand humanoids fall about and lie still, beside MuJoCo: speed, error, and the first charts."""
    from stepper import _demo  # noqa: PLC0415  (matplotlib, mujoco, rich: only when asked for)

    _demo.demo(_demo.Plan(num_envs=num_envs, steps=steps, rest=rest, seed=seed), out)


def chart(scene: str, out: Path, *, quick: bool) -> None:
    """Speed against accuracy: sweeps time steps and settings of stepper and of MuJoCo over a scene whose right answer is known."""
    from stepper import _demo, _demo_report  # noqa: PLC0415  (as above)
    from stepper._chart import SCENES, Effort  # noqa: PLC0415  (as above)

    names = list(SCENES)
    if scene not in (*names, "all"):
        raise ValueError(f'there is no scene "{scene}", there are: {", ".join(names)}, all')
    effort = Effort.quick() if quick else Effort()
    with _demo_report.progress() as tick:
        pictures = _demo.charts(names if scene == "all" else [scene], out, effort, tick)
    _demo_report.show_files([file for picture in pictures for file in (picture, picture.with_suffix(".csv"))])


def explain(model: str) -> None:
    """What of a model is simulated, what is left out and why, and what rigid bodies cannot model."""
    from stepper import ModelWarning, load  # noqa: PLC0415  (as above)

    with warnings.catch_warnings():
        # The report has it.
        warnings.simplefilter("ignore", ModelWarning)
        print(load(model, strict=False).explain())


def report(recording: Path) -> None:
    """What was in force in a recording, and what failed in it: physics, sensing or action."""
    from stepper.recording.format import HEADER, check_files, read_header, reading  # noqa: PLC0415  (as above)

    head = read_header(recording)
    check_files(recording, head)
    with reading(recording / HEADER):
        _report(recording, head)


def _report(recording: Path, head: dict[str, Any]) -> None:
    envs = "one environment" if head["num_envs"] is None else f"{head['num_envs']} environments"
    end = "" if head["closed"] else ", not closed: its end may be missing"
    print(f'{recording}: {head["rows"]} rows of {envs} of "{head["model"]["name"]}", dt {head["timestep"]:g} s, {head["precision"]}{end}')
    print(f"model {head['model']['sha256']}")
    if head["note"]:
        print(f"note: {head['note']}")
    settings = head["options"] | {"tolerance": head["tolerance"], "seed": head["seed"]}
    print(", ".join(f"{name} {value}" for name, value in settings.items() if value is not None))
    for failure in head["failures"]:
        row, env = failure["first"][0]
        word = "steps" if "steps" in failure else "readings"
        counts = ", ".join(f"{name} {count}" for name, count in failure.get(word, {}).items())
        print(
            f"{failure['whose']}: {failure['count']} times {failure['meaning']}, first in row {row}, environment {env}"
            + (f"; {word}: {counts}" if counts else "")
        )
    if not head["failures"]:
        print("nothing failed")


def replay(recording: Path, threads: int | None) -> None:
    """Repeats a recording and compares it bit for bit; says at which step and in which field it differs."""
    from stepper import replay as repeat  # noqa: PLC0415  (as above)

    result = repeat(recording, threads=threads)
    print(result)
    if not result:
        sys.exit(1)


def _app() -> Typer:
    """The commands with their options. Made here because typer is optional."""
    require("typer", "for the command line")
    import typer  # noqa: PLC0415  (as above)

    app = typer.Typer(help=__doc__, add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
    out = typer.Option("out", "--out", help="Folder for what is written.")

    @app.command("demo", help=demo.__doc__)
    def _(
        num_envs: int = typer.Option(1024, min=1, help="Humanoids."),
        steps: int = typer.Option(500, min=1, help="Steps of random control."),
        rest: int = typer.Option(1000, min=0, help="Steps without control after that."),
        seed: int = typer.Option(0, min=0, help="Of the random control."),
        out: Path = out,
    ) -> None:
        demo(num_envs, steps, rest, seed, out)

    @app.command("chart", help=chart.__doc__)
    def _(
        scene: str = typer.Argument("all", help="chain, box or all."),
        out: Path = out,
        quick: bool = typer.Option(False, "--quick", help="Fewer repeats and time steps."),
    ) -> None:
        chart(scene, out, quick=quick)

    @app.command("explain", help=explain.__doc__)
    def _(model: str = typer.Argument(help="An .xml, .urdf or saved model.")) -> None:
        explain(model)

    recording = typer.Argument(help="A folder that Stepper.record wrote.")

    @app.command("report", help=report.__doc__)
    def _(recording: Path = recording) -> None:
        report(recording)

    @app.command("replay", help=replay.__doc__)
    def _(recording: Path = recording, threads: int | None = typer.Option(None, min=0, help="Threads; as recorded without it.")) -> None:
        replay(recording, threads)

    return app


def main() -> None:
    """Entry point of the command `stepper`. What a user can mend is one line on stderr, without a traceback."""
    try:
        _app()()
    except (ImportError, ModelError, OSError, ValueError) as error:
        print(f"stepper: {error}", file=sys.stderr)
        sys.exit(1)
