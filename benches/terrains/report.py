"""The table of docs/benchmarks/terrain.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

PEERS = "MuJoCo"
PAGE = Path(__file__).parents[2] / "docs" / "benchmarks" / "terrain.md"
BEGIN, END = "<!-- table of benches/terrains -->", "<!-- end of the table -->"


def update_page(rows: Sequence[dict[str, Any]], came_from: Mapping[str, Any]) -> None:
    """Writes the table into docs/benchmarks/terrain.md."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    machine = f"{came_from['cpu']}, CPU level {came_from['cpu_level']}, {came_from['utc'][:10]}, load {came_from['load_average']}."
    PAGE.write_text(f"{before}{BEGIN}\n\n{table(rows)}\n\n{machine}\n\n{END}{after}", encoding="utf-8")


def table(rows: Sequence[dict[str, Any]]) -> str:
    """A markdown table with a line for every ground."""
    names = list(dict.fromkeys(name for row in rows for name in row["engines"]))
    ours, theirs = ([name for name in names if name.startswith(PEERS) == peer] for peer in (False, True))
    labels = [name.removeprefix("stepper ").removesuffix(" default") for name in ours]
    head = ["ground", *(f"us {label}" for label in labels), "us MuJoCo same / own", *(f"{label} x" for label in labels)]
    every = " / ".join(labels)
    head += [
        f"contacts {every} / MuJoCo",
        f"penetration mm {every} / MuJoCo",
        f"unsolved % {every}",
        f"iterations {every}",
        "other flags %",
    ]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        found = row["engines"]
        best = min((found[name]["microseconds"] for name in theirs), default=float("nan"))
        cells = [row["ground"], *(f"{found[name]['microseconds']:.2f}" for name in ours)]
        cells += [" / ".join(f"{found[name]['microseconds']:.1f}" for name in theirs)]
        cells += [f"{best / found[name]['microseconds']:.2f}" for name in ours]
        cells += [" / ".join(f"{found[name]['contacts']:.1f}" for name in names)]
        cells += [" / ".join(f"{1e3 * found[name]['penetration']:.2g}" for name in names)]
        cells += [" / ".join(f"{100 * found[name]['flags'].get('NOT_CONVERGED', 0):.2g}" for name in ours)]
        cells += [" / ".join(f"{found[name]['iterations']:.1f}" for name in ours)]
        flags = sorted({flag for name in ours for flag in found[name]["flags"]} - {"NOT_CONVERGED"})
        cells += [", ".join(f"{flag} " + " / ".join(f"{100 * found[n]['flags'].get(flag, 0):.2g}" for n in ours) for flag in flags)]
        lines.append(cells)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
