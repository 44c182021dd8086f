"""Help texts and functions that several commands share."""

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
STUDY = "Study: a .toml file, or a .py file with a stepper.lab.Study named study."
RECORDING = "Folder that Stepper.record wrote."
RAY = "Run batches as tasks of Ray, on all machines of its cluster."
RAY_RUNS = "Run settings as tasks of Ray, on all machines of its cluster; costs are measured on this machine."
ONLY = (
    "Parameter to vary: a name in the study, or a selector with its range, 'geom_friction[floor][0]=0.2..1'. "
    "Repeat the option for more; without it, all parameters of the study."
)
SEED = "Seed of all random numbers, in place of the study's; the same seed gives the same rows."
VALUES = "Value of a parameter, NAME=VALUE: a name in the study, or a selector, 'geom_friction[floor][0]=0.3'. Repeat the option for more."


@contextlib.contextmanager
def progress_kept_in(out: Path) -> Iterator[Tick]:
    """Progress display of a command that keeps finished rows in `out`; on Ctrl-C it prints how to continue."""
    try:
        with progress() as tick:
            yield tick
    except KeyboardInterrupt:
        print(f"stopped: finished rows are kept in {out}; the same command continues from them", file=sys.stderr)
        raise


def study_of_file(path: Path, *, ray: bool, seed: int | None = None) -> Study:
    """Study of a file. Prints the seed.

    Args:
        path: File of the study.
        ray: Whether to run on Ray; if False, the study decides.
        seed: Seed; None is the study's.
    """
    study = Study.from_file(path)
    print(f"{study.name}: seed {study.seed}, of the study" if seed is None else f"{study.name}: seed {seed}", file=sys.stderr, flush=True)
    changed: dict[str, Any] = ({"ray": True} if ray else {}) | ({} if seed is None else {"seed": seed})
    return replace(study, **changed) if changed else study


def source_with(source: str, *, ray: bool, values: Sequence[str] = ()) -> Any:
    """Model or study of a command, on Ray if `ray` is set, with the nominal values NAME=VALUE."""
    if not ray and not values:
        return source
    study = Study.from_model(source, ray=True) if ray else Study.from_model(source)
    return study.at(dict(map(value_of, values)))


def value_of(text: str) -> tuple[str, float | str]:
    """Name and value of a text NAME=VALUE. The value is a number or a word.

    Raises:
        ValueError: The text has another form.
    """
    name, sign, value = text.rpartition("=")
    if not (name and sign and value):
        raise ValueError(f"--values is {text!r}, must be NAME=VALUE; give it once for each parameter")
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return name, kind(value)
    return name, value
