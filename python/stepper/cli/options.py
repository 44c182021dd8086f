"""Help texts and functions that several commands use."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stepper.lab.progress import Tick, progress
from stepper.lab.study import Study

OUT = "Output folder."
STUDY = "Study: a .toml file, or a .py file with a variable study of type stepper.lab.Study."
RECORDING = "Folder of a recording by Stepper.record."
RAY = "Run batches as tasks of Ray, on all machines of its cluster."
RAY_RUNS = "Run the settings as tasks of Ray, on all machines of its cluster; costs are still measured on this machine."
ONLY = (
    "Parameter to vary: a name in the study, or a selector with a range, 'geom_friction[floor][0]=0.2..1'. "
    "Repeat the option for more; without it, all parameters of the study."
)
SEED = "Seed of all random numbers, instead of that of the study; the same seed gives the same rows."
VALUES = (
    "Value of a parameter for episodes in which it does not vary, in place of its nominal value: NAME=VALUE with a name in the study, or "
    "a selector, 'geom_friction[floor][0]=0.3'. Quote selectors for the shell. Repeat the option for more."
)


@contextlib.contextmanager
def progress_kept_in(out: Path) -> Iterator[Tick]:
    """Progress display for commands that store finished rows in `out`. On Ctrl-C it prints how to continue."""
    try:
        with progress() as tick:
            yield tick
    except KeyboardInterrupt:
        print(f"stopped: finished rows are kept in {out}; the same command continues from them", file=sys.stderr)
        raise


def study_of_file(path: Path, *, ray: bool, seed: int | None = None) -> Study:
    """Reads a study from a file, and prints its seed.

    Args:
        path: File of the study.
        ray: Whether to run on Ray; False keeps the setting of the study.
        seed: Seed; None is that of the study.
    """
    study = Study.from_file(path)
    print(f"{study.name}: seed {study.seed}, of the study" if seed is None else f"{study.name}: seed {seed}", file=sys.stderr, flush=True)
    changed: dict[str, Any] = ({"ray": True} if ray else {}) | ({} if seed is None else {"seed": seed})
    return replace(study, **changed) if changed else study


def source_with(source: str, *, ray: bool, values: Sequence[str] = ()) -> Any:
    """Argument `source` of a command as a model or study, on Ray with `ray`, and with the nominal values `values` (NAME=VALUE)."""
    if not ray and not values:
        return source
    study = Study.from_model(source, ray=True) if ray else Study.from_model(source)
    return study.at(values_of(values))


def values_of(texts: Sequence[str]) -> dict[str, float | str]:
    """Values by name from texts NAME=VALUE.

    Raises:
        ValueError: A text does not have this form, or a name has two values.
    """
    found: dict[str, float | str] = {}
    for name, value in map(value_of, texts):
        if found.setdefault(name, value) != value:
            raise ValueError(f"--values gives {name!r} twice, as {found[name]} and as {value}: give it once")
    return found


def value_of(text: str) -> tuple[str, float | str]:
    """Name and value from a text NAME=VALUE. The value is a number or else a string.

    Raises:
        ValueError: The text does not have this form.
    """
    name, sign, value = text.rpartition("=")
    if not (name and sign and value):
        raise ValueError(f"--values is {text!r}, must be NAME=VALUE; repeat the option for more parameters")
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return name, kind(value)
    return name, value
