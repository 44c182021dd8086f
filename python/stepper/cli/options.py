"""What options say of themselves that several commands have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from stepper.lab.study import Study

OUT = "Folder for what is written."
STUDY = "A study: a .toml file, or a .py file that has a stepper.lab.Study named study."
RECORDING = "A folder that Stepper.record wrote."
RAY = "Run batches as tasks of Ray, on all machines of its cluster."
RAY_RUNS = "Run settings as tasks of Ray, on all machines of its cluster; costs are measured here."
ONLY = "Only this parameter; may be given several times."


def of_file(path: Path, *, ray: bool) -> Study:
    """The study of a file, over Ray where that is asked for here or there."""
    study = Study.from_file(path)
    return replace(study, ray=True) if ray else study


def of_source(source: str, *, ray: bool) -> Any:
    """A model or a study, over Ray where that is asked for."""
    return Study.from_model(source, ray=True) if ray else source
