"""Speedups over MuJoCo: targets, measured values, and the values that stepper would reach at the floor of a step.

The floor of a step is the time that its arithmetic operations would take at the highest rate of this core, without memory accesses.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import Any

from many_contacts.episodes import Anatomy, Floors

Row = Mapping[str, Any]
PRECISIONS = ("f64", "f32")
UNSOLVED = 1e-4
"""Largest allowed fraction of unsolved environment steps."""
TARGETS = {
    "g1": (2.0, 3.3),
    "go1": (4.2, 7.0),
    "panda": (2.2, 3.6),
    "lift 0.05 kg": (1.2, 2.2),
    "lift 0.3 kg": (1.2, 2.2),
    "lift 2 kg": (1.2, 2.2),
    "heap of thirty": (0.45, 0.7),
    "wall: stands": (0.9, 2.0),
    "wall: impact": (0.25, 0.4),
    "two arms": (0.9, 1.4),
}
"""Target speedups over MuJoCo in f64 and f32, by the name of a scene or of one of its phases. Other scenes count in the mean alone."""
MEAN = (2.4, 3.8)
"""Target of the speedup over MuJoCo, as geometric mean over all scenes, in f64 and f32."""
ROBOTS, ALONE = (5.2, 8.5), (3.5,)
"""Target speedups over MuJoCo, as means over the robots of comparison/throughput.py.

The first tuple is for a batch of environments in f64 and f32, and the second one for a single environment in f64.
"""
AVX512 = 4 / 3
"""Factor on the targets on machines with AVX-512. The targets are for AVX2."""


def target_of(row: str) -> tuple[float, float] | None:
    """Target speedups over MuJoCo in f64 and f32 of a row of the tables, which is a scene or "scene: phase". None without a target."""
    return TARGETS.get(row) or TARGETS.get(row.partition(":")[0])


def scale(came_from: Mapping[str, Any]) -> float:
    """Factor on the target speedups for the CPU level of the measurements: `AVX512` with AVX-512, otherwise 1.

    `came_from` is the provenance of the measurements, such as the machine.
    """
    return AVX512 if came_from["cpu_level"] == "avx512" else 1.0


@dataclass(frozen=True)
class Reached:
    """Result of measuring an episode in one precision, with default settings.

    Attributes:
        name: Name of the episode.
        group: Name of the group of similar episodes, which together count as one in mean speedups.
        ratio: Speedup, the time of MuJoCo divided by that of stepper.
        micros: Time of stepper per environment step, us.
        unsolved: Fraction of environment steps that were not solved.
        anatomy: Parts of a step, and floor (least time of its arithmetic). None if not measured.
    """

    name: str
    group: str
    ratio: float
    micros: float
    unsolved: float
    anatomy: Anatomy | None

    @property
    def at_floor(self) -> float | None:
        """Speedup if a step of stepper took only the least time of its arithmetic (its floor)."""
        return None if self.anatomy is None else self.ratio * self.micros / self.anatomy.floor


def of_rows(rows: Iterable[Row], precision: str, floors: Floors) -> list[Reached]:
    """Results of all scenes in one precision, from the content of many_contacts.json."""
    return [
        Reached(
            row["row"],
            row["group"],
            found["ratio"],
            found["microseconds"],
            found["unsolved"],
            floors.get((row["row"], row["num_envs"], precision)),
        )
        for row in rows
        if (found := row["ours"].get(f"{precision} default"))
    ]


def robots(path: Path) -> Mapping[str, Any] | None:
    """Read the JSON file that comparison/throughput.py writes. The result is None if the file does not exist."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def of_robots(found: Mapping[str, Any], precision: str, floors: Floors, *, alone: bool = False) -> list[Reached]:
    """Results of the robots in throughput.json in one precision, for a batch of environments or for single environments.

    For single environments, the fraction of unsolved steps is nevertheless that of the batch.
    """
    name, kind = f"stepper {precision}", "_alone" if alone else ""
    num_envs = 1 if alone else found["plan"]["num_envs"]
    out = []
    for row in found["models"]:
        certificate = row["certificates"][name]
        unsolved = certificate["not_converged"] / certificate["env_steps"]
        ratio, micros = row[f"ratio{kind}"][name], row[f"microseconds{kind}"][name]
        out.append(Reached(row["model"], row["model"], ratio, micros, unsolved, floors.get((row["model"], num_envs, precision))))
    return out


def grouped_mean(found: Iterable[tuple[str, float]]) -> float | None:
    """Geometric mean over groups of the geometric mean in each group. The result is None if there are no numbers."""
    groups: dict[str, list[float]] = {}
    for group, number in found:
        groups.setdefault(group, []).append(number)
    return geometric_mean(geometric_mean(numbers) for numbers in groups.values()) if groups else None


def percent(share: float) -> str:
    """Text of a fraction of unsolved steps (`share`) in per cent, in bold type if the fraction is above `UNSOLVED`."""
    text = f"{100 * share:.2g}"
    return text if share <= UNSOLVED else f"**{text}**"


def mean(found: Sequence[Reached], value: Callable[[Reached], float | None]) -> float | None:
    """Geometric mean of a number over results, in which all results of a group count as one. The result is None if a number is missing."""
    numbers = [(one.group, value(one)) for one in found]
    known = [(group, number) for group, number in numbers if number is not None]
    return grouped_mean(known) if len(known) == len(numbers) else None


def part(found: Sequence[Reached]) -> tuple[str, float] | None:
    """Part of the step whose time is farthest above its floor (least time of its arithmetic), on average over some results.

    Returns:
        Name of the part, and its mean excess as a fraction of the step's time. None if the parts were not measured.
    """
    excesses = [one.anatomy.excess for one in found if one.anatomy]
    if len(excesses) < len(found):
        return None
    names = dict.fromkeys(name for excess in excesses for name in excess)
    shares = {name: fmean(excess.get(name, 0.0) for excess in excesses) for name in names}
    return max(shares.items(), key=lambda item: item[1]) if shares else None


def lines(rows: Sequence[Row], came_from: Mapping[str, Any], floors: Floors, throughput: Mapping[str, Any] | None) -> list[list[str]]:
    """Rows of the table that compares speedups over MuJoCo with their targets, each a list of cells with values for f64 / f32."""
    by_precision = [of_rows(rows, precision, floors) for precision in PRECISIONS]
    factor = scale(came_from)
    out = []
    for row in rows:
        target = target_of(row["row"])
        if target:
            own = [[one for one in found if one.name == row["row"]] for found in by_precision]
            out.append(_line(row["row"], target, own, factor))
    least = [[min(found, key=lambda one: one.ratio)] if found else [] for found in by_precision]
    names = " / ".join(dict.fromkeys(one.name for found in least for one in found))
    out.append(_line("geometric mean over scenes", MEAN, by_precision, factor))
    out.append(_line(f"smallest over scenes ({names})", None, least, factor))
    if throughput:
        factor = scale(throughput["provenance"])
        batch = [of_robots(throughput, precision, floors) for precision in PRECISIONS]
        out.append(_line(f"{len(batch[0])} robots, random control, mean", ROBOTS, batch, factor))
        out.append(_line("the robots, a single environment", ALONE, [of_robots(throughput, "f64", floors, alone=True)], factor))
    return out


def _line(what: str, targets: Sequence[float] | None, by_precision: Sequence[Sequence[Reached]], factor: float) -> list[str]:
    """Cells of one row in the table that compares speedups over MuJoCo with their targets."""
    cells: list[list[str]] = [[], [], [], [], []]
    scaled = [factor * target for target in targets] if targets else [None] * len(by_precision)
    for target, found in zip(scaled, by_precision, strict=True):
        ratio, at_floor, way = mean(found, lambda one: one.ratio), mean(found, lambda one: one.at_floor), part(found)
        worst = max(found, key=lambda one: one.unsolved, default=None)
        missed = ratio is not None and target is not None and ratio < target
        cells[0].append("-" if target is None else f"{target:.2g}")
        cells[1].append("-" if ratio is None else f"**{ratio:.2g}**" if missed else f"{ratio:.2g}")
        cells[2].append("-" if at_floor is None else f"{at_floor:.2g}")
        cells[3].append("-" if way is None else f"{way[0]} ({way[1]:.0%})")
        cells[4].append("-" if worst is None else _unsolved(worst, len(found) > 1))
    return [what, *(" / ".join(cell) for cell in cells)]


def _unsolved(worst: Reached, named: bool) -> str:
    """Text of the fraction of unsolved steps in a result, in per cent, with or without the episode's name."""
    text = percent(worst.unsolved)
    return f"{text} ({worst.name})" if named and worst.unsolved else text
