"""One row of the table: what was measured of one file. Judged elsewhere, so that a judgement can change without measuring again."""

from __future__ import annotations

import csv
import dataclasses
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True)
class Motion:
    """How one engine moved over the steps of an episode.

    Attributes:
        mean_energy: Mean kinetic energy after a step, J.
        max_energy: Largest kinetic energy after a step, J.
        hinge_excess: Farthest that a limited hinge went beyond its range, rad, where farther than at the start; 0 where none did.
        slide_excess: The same of slides, m.
    """

    mean_energy: float = 0.0
    max_energy: float = 0.0
    hinge_excess: float = 0.0
    slide_excess: float = 0.0


@dataclass(frozen=True)
class Episode:
    """The same controls for stepper and MuJoCo, from the reference pose.

    Attributes:
        steps: How many were made; fewer than asked for where the time ran out.
        not_converged: Share of stepper's steps with this flag; and so on for each flag.
        non_finite: See there.
        contacts_full: See there.
        unresolved: See there.
        tunnelled: See there.
        infeasible: See there.
        residual: Largest residual, m/s.
        ours: stepper's motion.
        theirs: MuJoCo's motion.
        warnings: What MuJoCo warned of, and how many times, as "BADQACC:3".
    """

    steps: int = 0
    not_converged: float = 0.0
    non_finite: float = 0.0
    contacts_full: float = 0.0
    unresolved: float = 0.0
    tunnelled: float = 0.0
    infeasible: float = 0.0
    residual: float = 0.0
    ours: Motion = field(default_factory=Motion)
    theirs: Motion = field(default_factory=Motion)
    warnings: str = ""


MEASURED, FRAGMENT, STILL, SAME = "measured", "fragment", "nothing moves", "same model"
REFUSED, FAILED, LATE, ABSENT = "refused", "failed", "out of time", "not downloaded"


@dataclass(frozen=True)
class Row:
    """One file of one package.

    Attributes:
        package: Its name.
        version: Its version.
        file: Path inside it; empty where the package cannot be downloaded.
        stepper: Digest of the library that measured.
        outcome: "measured", or why it was not.
        note: What that says in full.
        model: Digest of the compiled model.
        nv: Degrees of freedom.
        nu: Controls.
        nbody: Bodies.
        ngeom: Geoms.
        nmesh: Meshes.
        timestep: The model's own, s.
        strict: Whether `stepper.load` takes all of it.
        missing: Kinds of elements that change the motion and are left out otherwise, separated by "; ".
        load_seconds: stepper's time to load, from the compiled model, s.
        compile_seconds: MuJoCo's time to compile, s.
        overlap: Deepest overlap in the reference pose, m.
        hinge_outside: How far the reference pose has a hinge beyond its range, at most, rad.
        slide_outside: The same of slides, m.
        mass_error: Relative error of the mass matrix, the worst of the states.
        bias_error: Of the bias force.
        acceleration_error: Of the acceleration without constraints.
        random: Under random controls.
        rest: Without controls.
    """

    package: str
    version: str
    file: str
    stepper: str
    outcome: str
    note: str = ""
    model: str = ""
    nv: int = 0
    nu: int = 0
    nbody: int = 0
    ngeom: int = 0
    nmesh: int = 0
    timestep: float = 0.0
    strict: bool = False
    missing: str = ""
    load_seconds: float = 0.0
    compile_seconds: float = 0.0
    overlap: float = 0.0
    hinge_outside: float = 0.0
    slide_outside: float = 0.0
    mass_error: float = 0.0
    bias_error: float = 0.0
    acceleration_error: float = 0.0
    random: Episode = field(default_factory=Episode)
    rest: Episode = field(default_factory=Episode)

    @property
    def key(self) -> tuple[str, str, str]:
        """Which file this is a row of."""
        return self.package, self.version, self.file


def flatten(record: DataclassInstance, prefix: str = "") -> dict[str, str]:
    """Fields by name, those of fields that are dataclasses as "random.ours.mean_energy"; numbers with five digits."""
    flat: dict[str, str] = {}
    for entry in dataclasses.fields(record):
        value = getattr(record, entry.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            flat |= flatten(value, f"{prefix}{entry.name}.")
        else:
            flat[prefix + entry.name] = f"{value:.5g}" if isinstance(value, float) else str(value)
    return flat


def unflatten(kind: type[Any], flat: Mapping[str, str], prefix: str = "") -> Any:
    """The inverse of `flatten`, for a type of dataclass."""
    values: dict[str, Any] = {}
    for name, of in get_type_hints(kind).items():
        if dataclasses.is_dataclass(of) and isinstance(of, type):
            values[name] = unflatten(of, flat, f"{prefix}{name}.")
        else:
            text = flat[prefix + name]
            values[name] = text == "True" if of is bool else of(text)
    return kind(**values)


def write_csv(path: Path, rows: Iterable[Row], notes: Mapping[str, object]) -> None:
    """Every row, under comment lines that say where it comes from. The file is whole at any time."""
    draft = path.with_suffix(".part")
    with draft.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {key}: {json.dumps(value)}\n" for key, value in notes.items())
        writer = csv.DictWriter(file, flatten(Row("", "", "", "", "")).keys())
        writer.writeheader()
        writer.writerows(flatten(row) for row in rows)
    draft.replace(path)


def read_csv(path: Path) -> tuple[list[Row], dict[str, object]]:
    """What `write_csv` wrote; nothing where there is no file yet."""
    if not path.exists():
        return [], {}
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    notes = {key: json.loads(value) for key, value in (line[2:].split(": ", 1) for line in lines if line.startswith("# "))}
    return [unflatten(Row, flat) for flat in csv.DictReader(line for line in lines if not line.startswith("# "))], notes
