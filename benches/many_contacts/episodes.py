"""Episodes: recordings that `anatomy --episode` (benches/src/bin/anatomy.rs) steps again, and what it found: parts and floors.

A floor is the time that the arithmetic of a step would take at the rates of the core, in lanes: docs/benchmarks/performance.md.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from comparison.throughput import PLAN, cases
from stepper import Stepper
from stepper._options import Precision
from stepper.lab.engines import StepperBatch


@contextmanager
def episode(sim: Stepper, folder: Path, name: str) -> Iterator[None]:
    """Records what a batch does, in place of an older episode of that name and kind of batch.

    Args:
        sim: The batch.
        folder: Where episodes are kept.
        name: Of the episode: what finds its floor again.
    """
    place = folder / re.sub(r"\W+", "_", f"{name}-{sim.num_envs}-{sim.precision}")
    # Only what is a recording is removed; anything else is refused by the recorder.
    if (place / "run.json").exists():
        shutil.rmtree(place)
    with sim.record(place, note=name):
        yield


def save_robots(folder: Path, precisions: Iterable[Precision], only: list[str]) -> None:
    """Records the robots of comparison/throughput.py under its random control, with default settings.

    Args:
        folder: Where episodes are kept.
        precisions: "f64", "f32".
        only: Parts of names; none is all.
    """
    for case in cases(PLAN, only):
        if isinstance(case, str):
            sys.stderr.write(f"left out: {case}\n")
            continue
        for precision in precisions:
            batch = StepperBatch(case.model, PLAN.num_envs, precision=precision)
            with episode(batch.sim, folder, case.name):
                for step in range(PLAN.steps):
                    batch.step(case.control[step // PLAN.hold])


@dataclass(frozen=True)
class Anatomy:
    """What `anatomy` found of an episode.

    Attributes:
        micros: Time of a step of an environment, us.
        floor: The least that it could be, us.
        parts: Time and floor of every part of the step, us.
    """

    micros: float
    floor: float
    parts: Mapping[str, tuple[float, float]]

    @property
    def excess(self) -> dict[str, float]:
        """What every part takes beyond its floor, as a share of the step's time."""
        whole = sum(micros for micros, _ in self.parts.values())
        return {name: (micros - floor) / whole for name, (micros, floor) in self.parts.items()}

    @property
    def farthest(self) -> tuple[str, float]:
        """The part that is farthest above its floor, and how far, as a share of the step's time."""
        return max(self.excess.items(), key=lambda part: part[1])


Floors: TypeAlias = Mapping[tuple[str, int, str], Anatomy]
"""By name of the episode, number of environments and precision."""


def floors(path: Path) -> Floors:
    """What `anatomy --json` wrote; nothing where there is no file."""
    if not path.exists():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))["episodes"]
    return {(e["name"], e["num_envs"], e["precision"]): _anatomy(e) for e in found}


def _anatomy(found: Mapping[str, Any]) -> Anatomy:
    return Anatomy(found["micros"], found["floor"], {part["name"]: (part["micros"], part["floor"]) for part in found["parts"]})
