"""Report of the comparison of stepper with MuJoCo: lines for the terminal, CSV file, and table of docs/benchmarks/mujoco_law.md."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sections import write_section
from stepper.lab.study.document import markdown_table

from mujoco_law.parity import Parity


@dataclass(frozen=True)
class Row:
    """Comparison of one model, as a row of the table.

    Attributes:
        name: Package and name of the model.
        nv: Number of degrees of freedom.
        left_out: Elements that are not simulated, or reason why the model cannot be loaded.
        parity: Result of the comparison. None if the model cannot be loaded.
    """

    name: str
    nv: int
    left_out: str
    parity: Parity | None

    def __str__(self) -> str:
        p = self.parity
        if p is None:
            return f"{self.name}: {self.left_out}"
        return " ".join([f"{self.name:36}", *(f"{key} {value}" for key, value in self.cells().items()), self.left_out])

    def cells(self) -> dict[str, str]:
        """Cells of this model's row in the table, by the heading of the column; empty if the model was not compared."""
        p = self.parity
        if p is None:
            return {}
        return {
            "nv": str(self.nv),
            "touching": f"{100 * p.touching:.0f} %",
            "same contacts": f"{100 * p.same:.0f} %",
            "agree": f"{100 * p.agrees:.0f} %" if len(p.error) else "-",
            "median": _number(p.error, 0.5),
            "largest": _number(p.error, 1.0),
            "spread of MuJoCo's solvers": _number(p.spread, 1.0),
            "Newton steps": f"{p.newton_steps:.1f}",
        }


def _number(values: np.ndarray[tuple[int], np.dtype[np.float64]], quantile: float) -> str:
    """Text of a quantile of some numbers."""
    return f"{np.quantile(values, quantile):.0e}" if len(values) else "-"


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write the table of results as CSV, with a line for each model."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        header = next((list(row.cells()) for row in rows if row.parity), [])
        writer.writerow(["model", *header, "omitted"])
        for row in rows:
            writer.writerow([row.name, *(row.cells().values() or [""] * len(header)), row.left_out])


def write_table(path: Path, rows: list[Row]) -> None:
    """Replace the table of the page docs/benchmarks/mujoco_law.md (the file `path`) by the results in `rows`."""
    measured = [row for row in rows if row.parity]
    header = ["model", *measured[0].cells(), "omitted"] if measured else []
    lines = [markdown_table(header, ([row.name, *row.cells().values(), row.left_out] for row in measured))]
    lines += [f"\nNot measured: {row.name}: {row.left_out}" for row in rows if not row.parity]
    write_section(path, "parity", "\n".join(lines))
