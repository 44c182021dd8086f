"""The table of a study: a row for every episode, a column for everything that is known of it."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.journal import Row
from stepper.shared.machine import require


class Table:
    """Rows of a study as columns.

    Columns are "setting", "episode", "seed"; "theta.NAME" (NaN or "" where a parameter is as the model has it); "outcome.NAME"; "success"
    (1, 0, or -1 without one); "status" (flags of `stepper.Status`), "residual" (m/s), "max_penetration" (m),
    "max_limit_violation" (rad or m),
    "max_equality_violation" (m or rad), the worst of the episode; "settings.NAME", in force; and "in_force", which names an entry of
    in_force.json.

    Args:
        rows: As the journal has them.
    """

    def __init__(self, rows: Sequence[Row]):
        self.rows = list(rows)
        flat = [_flat(row) for row in self.rows]
        names = list(dict.fromkeys(name for row in flat for name in row))
        self.columns: dict[str, NDArray[Any]] = {name: _column([row.get(name) for row in flat]) for name in names}

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def save(self, folder: Path, name: str = "table") -> list[Path]:
        """Writes NAME.csv and NAME.npz, and NAME.parquet where pyarrow is installed."""
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{name}.csv", folder / f"{name}.npz"]
        with files[0].open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
        # As a mapping: names have dots.
        np.savez(files[1], **self.columns)  # type: ignore[arg-type]
        if importlib.util.find_spec("pyarrow") is not None:
            arrow, parquet = require("pyarrow", "to write Parquet"), require("pyarrow.parquet", "to write Parquet")
            files.append(folder / f"{name}.parquet")
            parquet.write_table(arrow.table({own: column.tolist() for own, column in self.columns.items()}), files[-1])
        return files


def _flat(row: Row) -> dict[str, Any]:
    success = row["success"]
    return {
        "setting": row["setting"],
        "episode": row["episode"],
        "seed": row["seed"],
        **{f"theta.{name}": value for name, value in row["theta"].items()},
        **{f"outcome.{name}": value for name, value in row["outcomes"].items()},
        "success": -1 if success is None else int(success),
        **row["certificate"],
        **{f"settings.{name}": value for name, value in row["settings"].items()},
        "in_force": row["in_force"],
    }


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Numbers, with NaN for none; or words, with "" for none."""
    given = [value for value in values if value is not None]
    if any(isinstance(value, str) for value in given):
        return np.array(["" if value is None else str(value) for value in values])
    if given and len(given) == len(values) and all(isinstance(value, int) for value in given):
        return np.array(values, np.int64)
    return np.array([np.nan if value is None else float(value) for value in values])
