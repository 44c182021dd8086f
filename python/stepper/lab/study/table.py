"""Table of a study's episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.journal import Row
from stepper.shared.files import write_arrays, write_csv


class Table:
    """Table of n episodes of a study. Its columns are arrays (n,), as `table["outcome.lifted"]`.

    Columns:

    * "setting", "episode", "seed": name of the settings, number and seed of the episode
    * "parameters.NAME": value of a parameter; NaN (or "" among texts) if the parameter did not change the model's number
    * "outcome.NAME": value of an outcome
    * "success": 1, 0, or -1 if the study has no condition of success
    * "cause", in tables of `report`: cause of a failure; "" for a success, and for a failure in MuJoCo that was not examined
    * "status": flags of `stepper.Status` over the episode
    * "residual" (m/s), "max_penetration" (m), "max_limit_violation" (rad or m), "max_equality_violation" (m or rad): largest in the episode
    * "settings.NAME": setting of the engine
    * "resolved_settings": key of an entry in resolved_settings.json, with model, versions and digests

    Args:
        rows: Rows of the journal.
        causes: Causes of failures, by the keys of their rows; None leaves the column out.
    """

    def __init__(self, rows: Sequence[Row], causes: Mapping[str, str] | None = None):
        self.rows = list(rows)
        flat = [_flat(row, None if causes is None else causes.get(row["key"], "")) for row in self.rows]
        names = list(dict.fromkeys(name for row in flat for name in row))
        self.columns: dict[str, NDArray[Any]] = {name: _column([row.get(name) for row in flat]) for name in names}

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def save(self, folder: Path, name: str = "table") -> list[Path]:
        """Writes NAME.csv and NAME.npz, and returns their paths."""
        rows = zip(*(column.tolist() for column in self.columns.values()), strict=True)
        return [write_csv(folder / f"{name}.csv", [self.columns, *rows]), write_arrays(folder / f"{name}.npz", self.columns)]


def _flat(row: Row, cause: str | None) -> dict[str, Any]:
    """Row of the journal as a flat dictionary with the names of the table's columns."""
    success = row["success"]
    return {
        "setting": row["setting"],
        "episode": row["episode"],
        "seed": row["seed"],
        **{f"parameters.{name}": value for name, value in row["parameters"].items()},
        **{f"outcome.{name}": value for name, value in row["outcomes"].items()},
        "success": -1 if success is None else int(success),
        **({} if cause is None else {"cause": cause}),
        **row["quality"],
        **{f"settings.{name}": value for name, value in row["settings"].items()},
        "resolved_settings": row["resolved_settings"],
    }


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Column of a table as an array of numbers or of words. Missing values (None) become NaN among numbers, and "" among words."""
    given = [value for value in values if value is not None]
    if any(isinstance(value, str) for value in given):
        return np.array(["" if value is None else str(value) for value in values])
    if given and len(given) == len(values) and all(isinstance(value, int) for value in given):
        return np.array(values, np.int64)
    return np.array([np.nan if value is None else float(value) for value in values])
