"""Tables of docs/benchmarks/terrain.md: step times, contacts and penetration on each kind of ground."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sections import write_section
from stepper.lab.study.document import markdown_table

PAGE = Path(__file__).parents[2] / "docs" / "benchmarks" / "terrain.md"

LEVELS = ("avx2", "avx512")
"""CPU levels with a table of times on the page."""


def update_page(rows: Sequence[dict[str, Any]], came_from: Mapping[str, Any]) -> None:
    """Write the tables into docs/benchmarks/terrain.md.

    Raises:
        ValueError: The page has no table for this CPU level.
    """
    level = came_from["cpu_level"]
    if level not in LEVELS:
        raise ValueError(f"{PAGE.name} has no table for the CPU level {level!r}: set STEPPER_CPU_LEVEL to {' or '.join(LEVELS)}")
    machine = f"{came_from['cpu']}, CPU level {level}, {came_from['utc'][:10]}, load {came_from['load_average']}."
    write_section(PAGE, f"times {level}", f"{times(rows)}\n\n{machine}")
    write_section(PAGE, "steps", steps(rows))


def times(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown table of times per step, us, with the speedup over MuJoCo's faster setting in parentheses."""
    ours, theirs = rows[0]["ours"], rows[0]["theirs"]
    head = ["ground", *map(_label, ours), *(name.removeprefix("MuJoCo ") + " (MuJoCo)" for name in theirs)]
    lines = [
        [
            row["scene"],
            *(f"{row['ours'][name]['microseconds']:.1f} ({row['ours'][name]['ratio']:.2f})" for name in ours),
            *(f"{row['theirs'][name]['microseconds']:.1f}" for name in theirs),
        ]
        for row in rows
    ]
    return markdown_table(head, lines)


def steps(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown table of contacts, deepest penetration, iterations and flags of each engine on each ground."""
    lines = []
    for row in rows:
        for name, engine in (row["ours"] | row["theirs"]).items():
            cells = [row["scene"], _label(name), f"{engine['contacts']:.1f}", f"{1e3 * engine['penetration']:.2g}", "", "", ""]
            if name in row["ours"]:
                others = (f"{flag} {100 * share:.2g}" for flag, share in sorted(engine["flags"].items()) if flag != "NOT_CONVERGED")
                iterations = engine["sweeps"] + engine["newton_steps"]
                cells[4:] = [f"{iterations:.1f}", f"{100 * engine['unsolved']:.2g}", ", ".join(others)]
            lines.append(cells)
    return markdown_table(["ground", "engine", "contacts", "penetration, mm", "iterations", "NOT_CONVERGED, %", "other flags, %"], lines)


def _label(name: str) -> str:
    """Name of an engine and its setting in the tables."""
    return name.removesuffix(" default")
