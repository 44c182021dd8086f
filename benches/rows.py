"""Results of a benchmark as a CSV file: a row for each object of a dataclass, below comment lines with their provenance."""

from __future__ import annotations

import csv
import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

RowT = TypeVar("RowT", bound="DataclassInstance")


def flatten(record: DataclassInstance, prefix: str = "") -> dict[str, str]:
    """Fields of a dataclass object as texts by name.

    Nested fields have names such as "random.ours.mean_energy"; numbers have five digits.
    """
    flat: dict[str, str] = {}
    for entry in dataclasses.fields(record):
        value = getattr(record, entry.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            flat |= flatten(value, f"{prefix}{entry.name}.")
        else:
            flat[prefix + entry.name] = f"{value:.5g}" if isinstance(value, float) else str(value)
    return flat


def unflatten(kind: type[RowT], flat: Mapping[str, str], prefix: str = "") -> RowT:
    """Object of a dataclass from texts by name, as `flatten` makes them."""
    values: dict[str, Any] = {}
    for name, of in get_type_hints(kind).items():
        if dataclasses.is_dataclass(of) and isinstance(of, type):
            values[name] = unflatten(of, flat, f"{prefix}{name}.")
        else:
            text = flat[prefix + name]
            values[name] = text == "True" if of is bool else of(text)
    return kind(**values)


def write_csv(path: Path, rows: Iterable[DataclassInstance], notes: Mapping[str, object]) -> None:
    """Write all rows and their provenance. The file is replaced atomically."""
    draft, lines = path.with_suffix(".part"), [flatten(row) for row in rows]
    with draft.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {key}: {json.dumps(value)}\n" for key, value in notes.items())
        writer = csv.DictWriter(file, lines[0] if lines else [])
        writer.writeheader()
        writer.writerows(lines)
    draft.replace(path)


def read_csv(path: Path, kind: type[RowT]) -> tuple[list[RowT], dict[str, object]]:
    """Rows of a dataclass and their provenance from a file of `write_csv`. Both are empty if the file does not exist."""
    if not path.exists():
        return [], {}
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    notes = {key: json.loads(value) for key, value in (line[2:].split(": ", 1) for line in lines if line.startswith("# "))}
    return [unflatten(kind, flat) for flat in csv.DictReader(line for line in lines if not line.startswith("# "))], notes


def provenance_section(notes: Mapping[str, object]) -> str:
    """Section of a page with the provenance of its results: machine, versions and time of the measurement."""
    lines = (f"* {key}: {value if isinstance(value, str) else json.dumps(value)}\n" for key, value in notes.items())
    return "## Provenance\n\n" + "".join(lines)
