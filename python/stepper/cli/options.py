"""Options and functions that several commands use."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from stepper.lab.study import Study
from stepper.shared.arguments import argument_values, name_values
from stepper.shared.progress import ProgressCallback, show_files, show_progress

STUDY = "Study: a .toml file, or a .py file with a variable study of type stepper.lab.Study, or a function study(data) that returns one."
RECORDING = "Folder of a recording by Stepper.record."
VALUES = (
    "Value of a parameter for episodes in which it does not vary, in place of its nominal value: NAME=VALUE with a name in the study, or "
    "a selector, 'gravity[2]=-3.7'. Quote selectors for the shell. Repeat the option for more."
)
ARGUMENTS = (
    "Argument of the environment, NAME=VALUE, such as a field of its task: roughness=0.1, or a weight of a term of the reward: "
    "rewards.pose=0.5. Repeat the option for more. The error for an unknown name lists all names."
)

Out = Annotated[Path, typer.Option("--out", help="Output folder.")]
Data = Annotated[Path | None, typer.Option("--data", help="Folder of measured data, for a study that is a function of it.")]
StudyFile = Annotated[Path, typer.Argument(help=STUDY)]
Source = Annotated[str, typer.Argument(help="Model (MJCF, URDF, saved) or study (.toml, .py).")]
Varied = Annotated[
    list[str] | None,
    typer.Option(
        help="Parameter to vary: a name in the study, or a selector with a range, 'gravity[2]=-9..-3'. "
        "Repeat the option for more; without it, all parameters of the study."
    ),
]
Seed = Annotated[
    int | None, typer.Option(min=0, help="Seed of all random numbers, instead of that of the study; the same seed gives the same rows.")
]
Setting = Annotated[str, typer.Option(help="Name of the study's settings to run.")]
Values = Annotated[list[str] | None, typer.Option("--values", help=VALUES)]
Arguments = Annotated[list[str] | None, typer.Option("--values", help=ARGUMENTS)]


@contextlib.contextmanager
def progress_kept_in(out: Path) -> Iterator[ProgressCallback]:
    """Context manager with a progress display, for commands that store results in the folder `out`. On Ctrl-C it prints how to continue."""
    try:
        with show_progress() as progress:
            yield progress
    except KeyboardInterrupt:
        print(f"stopped: finished rows are kept in {out}; the same command continues from them", file=sys.stderr)
        raise


def show(found: Any) -> None:
    """Prints the document of a result, and the paths of its files."""
    print(found.document.markdown())
    show_files(found.files)


def study_of_file(path: Path, seed: int | None = None, data: Path | None = None) -> Study:
    """Reads a study from a file and a folder of data, and prints its seed. `seed` replaces the study's seed, unless it is None."""
    study = Study.from_file(path, data)
    print(f"{study.name}: seed {study.seed}, of the study" if seed is None else f"{study.name}: seed {seed}", file=sys.stderr, flush=True)
    return study if seed is None else replace(study, seed=seed)


def source_with(source: str, values: Sequence[str] | None, data: Path | None) -> Any:
    """Argument `source` of a command, or the study with the values and the data of the options --values and --data."""
    given = source if data is None else Study.from_file(source, data)
    return Study.from_model(given).at(values_of(values)) if values else given


def values_of(texts: Sequence[str]) -> dict[str, float | str]:
    """Values of the option --values for studies: numbers or else strings, by name; a ValueError for a text that is not NAME=VALUE."""
    return name_values(texts, "--values", number_or_text)


def arguments_of(texts: Sequence[str]) -> dict[str, Any]:
    """Arguments of an environment by name, from the option --values; a ValueError for a text that is not NAME=VALUE."""
    return argument_values(texts, "--values")


def number_or_text(text: str) -> float | str:
    """Number that a text contains, or the text itself if it is no number."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text
