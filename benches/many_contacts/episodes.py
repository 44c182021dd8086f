"""Recordings of simulations (episodes), and the times of the parts of a step that are measured from them.

The program `anatomy --episode` (benches/src/bin/anatomy.rs) replays the recordings, and measures each part of a step and its floor. The
floor is the time that the arithmetic would take at the peak rates of a core with SIMD lanes (docs/benchmarks/performance.md).
"""

import json
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from comparison.throughput import PLAN, cases
from stepper import Stepper
from stepper._options import Precision
from stepper.lab.engines import StepperBatch


@contextmanager
def episode(sim: Stepper, folder: Path, name: str) -> Iterator[None]:
    """Record all steps of a batch within a `with` block, as an episode that the program `anatomy` can replay and measure.

    An earlier recording with the same name, number of environments and precision is replaced.
    """
    place = folder / re.sub(r"\W+", "_", f"{name}-{sim.num_envs}-{sim.precision}")
    # Only recordings are removed; the recorder raises an error for other content.
    if (place / "run.json").exists():
        shutil.rmtree(place)
    with sim.record(place, note=name):
        yield


def save_robots(folder: Path, precisions: Iterable[Precision], only: list[str]) -> None:
    """Record the robots of comparison/throughput.py with its random controls and default settings."""
    for case in cases(PLAN, only):
        if isinstance(case, str):
            sys.stderr.write(f"skipped {case}\n")
            continue
        for precision in precisions:
            batch = StepperBatch(case.model, PLAN.num_envs, precision=precision)
            with episode(batch.sim, folder, case.name):
                for step in range(PLAN.steps):
                    batch.step(case.control[step // PLAN.hold])


@dataclass(frozen=True)
class Anatomy:
    """Times of the parts of a step in an episode, measured by the program `anatomy`.

    Attributes:
        micros: Time of an environment step, us.
        floor: Floor of this time (least time of its arithmetic), us.
        parts: Time and floor by name of the part of the step, us.
    """

    micros: float
    floor: float
    parts: Mapping[str, tuple[float, float]]

    @property
    def excess(self) -> dict[str, float]:
        """Difference between time and floor (least time of the arithmetic) of each part, as a fraction of the step's time."""
        whole = sum(micros for micros, _ in self.parts.values())
        return {name: (micros - floor) / whole for name, (micros, floor) in self.parts.items()}

    @property
    def farthest(self) -> tuple[str, float]:
        """Name of the part with the largest difference between time and floor, and this difference as a fraction of the step's time."""
        return max(self.excess.items(), key=lambda part: part[1])


Floors: TypeAlias = Mapping[tuple[str, int, str], Anatomy]
"""Measured times and floors of the parts of a step, by name of the episode, number of environments and precision."""


def floors(path: Path) -> Floors:
    """Read the times of the parts of a step from a JSON file that the program `anatomy` has written with its option --json.

    The result is empty if the file does not exist.
    """
    if not path.exists():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))["episodes"]
    parts = [{part["name"]: (part["micros"], part["floor"]) for part in e["parts"]} for e in found]
    return {(e["name"], e["num_envs"], e["precision"]): Anatomy(e["micros"], e["floor"], p) for e, p in zip(found, parts, strict=True)}
