"""What options say of themselves that several commands have."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from stepper.lab.progress import Tick, progress
from stepper.lab.study import Study

OUT = "Folder for what is written."
STUDY = "A study: a .toml file, or a .py file that has a stepper.lab.Study named study."
RECORDING = "A folder that Stepper.record wrote."
RAY = "Run batches as tasks of Ray, on all machines of its cluster."
RAY_RUNS = "Run settings as tasks of Ray, on all machines of its cluster; costs are measured here."
ONLY = "Only this parameter, by name, or a selector with its range, 'geom_friction[floor][0]=0.2..1'; may be given several times."
SEED = "Seed of all random numbers, in place of the study's; the same seed gives the same rows."
VALUES = "NAME=VALUE of a study's parameter, or of a selector, 'geom_friction[floor][0]=0.3'; once for each."


@contextlib.contextmanager
def progress_kept_in(out: Path) -> Iterator[Tick]:
    """Progress of a command that keeps finished rows in `out`; Ctrl-C prints how to continue it."""
    try:
        with progress() as tick:
            yield tick
    except KeyboardInterrupt:
        print(f"stopped: finished rows are kept in {out}, and the same command continues", file=sys.stderr)
        raise


def of_file(path: Path, *, ray: bool, seed: int | None = None) -> Study:
    """The study of a file, over Ray where that is asked for here or there, with another seed if one is given; the seed is printed."""
    study = Study.from_file(path)
    print(f"{study.name}: seed {study.seed}, of the study" if seed is None else f"{study.name}: seed {seed}", file=sys.stderr, flush=True)
    changed: dict[str, Any] = ({"ray": True} if ray else {}) | ({} if seed is None else {"seed": seed})
    return replace(study, **changed) if changed else study


def of_source(source: str, *, ray: bool, values: Sequence[str] = ()) -> Any:
    """A model or a study, over Ray if `ray` is set, with other nominal values."""
    if not ray and not values:
        return source
    study = Study.from_model(source, ray=True) if ray else Study.from_model(source)
    return study.at(dict(map(value_of, values)))


def value_of(text: str) -> tuple[str, float | str]:
    """Name and value of NAME=VALUE, a number or a word.

    Raises:
        ValueError: Another form.
    """
    name, sign, value = text.rpartition("=")
    if not (name and sign and value):
        raise ValueError(f"--values is {text!r}, must be NAME=VALUE; give it once for each parameter")
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return name, kind(value)
    return name, value
