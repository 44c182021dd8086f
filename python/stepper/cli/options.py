"""Help texts and functions that several commands use."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stepper.lab.progress import ProgressCallback, show_progress
from stepper.lab.study import Study
from stepper.shared.name_values import argument_values, name_values

OUT = "Output folder."
STUDY = "Study: a .toml file, or a .py file with a variable study of type stepper.lab.Study."
RECORDING = "Folder of a recording by Stepper.record."
RAY = "Run batches as tasks of Ray, on all machines of its cluster."
RAY_RUNS = "Run the settings as tasks of Ray, on all machines of its cluster; costs are still measured on this machine."
ONLY = (
    "Parameter to vary: a name in the study, or a selector with a range, 'gravity[2]=-9..-3'. "
    "Repeat the option for more; without it, all parameters of the study."
)
SEED = "Seed of all random numbers, instead of that of the study; the same seed gives the same rows."
VALUES = (
    "Value of a parameter for episodes in which it does not vary, in place of its nominal value: NAME=VALUE with a name in the study, or "
    "a selector, 'gravity[2]=-3.7'. Quote selectors for the shell. Repeat the option for more."
)


ARGUMENTS = (
    "Argument of the environment, NAME=VALUE, such as a field of its task: roughness=0.1, or a weight of a term of the reward: "
    "rewards.pose=0.5. Repeat the option for more. The error for an unknown name lists all names."
)


@contextlib.contextmanager
def progress_kept_in(out: Path) -> Iterator[ProgressCallback]:
    """Context manager with a progress display, for commands that store results in the folder `out`. On Ctrl-C it prints how to continue."""
    try:
        with show_progress() as progress:
            yield progress
    except KeyboardInterrupt:
        print(f"stopped: finished rows are kept in {out}; the same command continues from them", file=sys.stderr)
        raise


def study_of_file(path: Path, *, ray: bool, seed: int | None = None) -> Study:
    """Reads a study from a file, and prints its seed.

    Args:
        path: File of the study.
        ray: Whether to run on Ray, a library for parallel tasks. False keeps the setting of the study.
        seed: Seed that replaces the seed of the study; None keeps it.
    """
    study = Study.from_file(path)
    print(f"{study.name}: seed {study.seed}, of the study" if seed is None else f"{study.name}: seed {seed}", file=sys.stderr, flush=True)
    changed: dict[str, Any] = ({"ray": True} if ray else {}) | ({} if seed is None else {"seed": seed})
    return replace(study, **changed) if changed else study


def source_with(source: str, *, ray: bool, values: Sequence[str] = ()) -> Any:
    """Argument `source` of a command, with the options --ray and --values applied.

    Without these options, the result is `source` itself. With them, it is a study.
    """
    if not ray and not values:
        return source
    study = Study.from_model(source, ray=True) if ray else Study.from_model(source)
    return study.at(values_of(values))


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
