"""Tables of docs/benchmarks/terrain.md: step times, contacts and penetration on each kind of ground."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sections import write_section
from stepper.lab.study.document import markdown_table

PEERS = "MuJoCo"
"""First word of the names of MuJoCo's settings."""
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


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Two markdown tables: step times with their ratios, and contacts, penetration and flags."""
    return f"{times(rows)}\n\n{steps(rows)}"


def times(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown table of times per step, us, with the speedup over MuJoCo's faster setting in parentheses."""
    ours, theirs = _engines(rows)
    lines = [["ground", *map(_label, ours), *(name.removeprefix(PEERS).strip() + " (MuJoCo)" for name in theirs)]]
    for row in rows:
        time = {name: engine["microseconds"] for name, engine in row["engines"].items()}
        best = min((time[name] for name in theirs), default=float("nan"))
        cells = [f"{time[name]:.1f} ({best / time[name]:.2f})" for name in ours]
        lines.append([row["ground"], *cells, *(f"{time[name]:.1f}" for name in theirs)])
    return _markdown(lines)


def steps(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown table of contacts, deepest penetration, iterations and flags of each engine on each ground."""
    lines = [["ground", "engine", "contacts", "penetration, mm", "iterations", "NOT_CONVERGED, %", "other flags, %"]]
    for row in rows:
        for name, engine in row["engines"].items():
            cells = [row["ground"], _label(name), f"{engine['contacts']:.1f}", f"{1e3 * engine['penetration']:.2g}"]
            if name.startswith(PEERS):
                lines.append([*cells, "", "", ""])
                continue
            flags = engine["flags"]
            others = ", ".join(f"{flag} {100 * share:.2g}" for flag, share in sorted(flags.items()) if flag != "NOT_CONVERGED")
            lines.append([*cells, f"{engine['iterations']:.1f}", f"{100 * flags.get('NOT_CONVERGED', 0):.2g}", others])
    return _markdown(lines)


def _engines(rows: Sequence[dict[str, Any]]) -> tuple[list[str], list[str]]:
    """Names of stepper's settings and names of MuJoCo's settings in the rows of the measurement."""
    names = list(dict.fromkeys(name for row in rows for name in row["engines"]))
    return [name for name in names if not name.startswith(PEERS)], [name for name in names if name.startswith(PEERS)]


def _label(name: str) -> str:
    """Heading of a column of the tables, from the name of an engine and its setting."""
    return name.removeprefix("stepper ").removesuffix(" default")


def _markdown(lines: list[list[str]]) -> str:
    """Markdown table from lists of cells: the first list has the headings."""
    return markdown_table(lines[0], lines[1:])
