"""The table, on the terminal and in docs/many_contacts.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import geometric_mean
from typing import Any

from many_contacts.measure import PEERS
from many_contacts.scene import MEAN

Row = Mapping[str, Any]
UNSOLVED = 1e-4
"""Share of environment-steps that may be unsolved."""


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    return "\n".join([_line(head), _line(["---"] * len(head)), *map(_line, lines)])


def _both(values: Iterable[object]) -> str:
    return " / ".join(map(str, values))


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.2g}"


def _slip(found: Sequence[float] | None) -> str:
    if found is None:
        return ""
    return _mm(found[0]) + (f" ({found[1]:.0%} dropped)" if found[1] else "")


def means(rows: Sequence[Row], column: str) -> float | None:
    """Geometric mean of a column's ratios over scenes, of which the rows of a group count once together."""
    groups: dict[str, list[float]] = {}
    for row in rows:
        if column in row["ours"]:
            groups.setdefault(row["group"], []).append(row["ours"][column]["ratio"])
    return geometric_mean(geometric_mean(found) for found in groups.values()) if groups else None


def speed(rows: Sequence[Row]) -> str:
    """Times and ratios beside their targets, and what is beside them: the share of unsolved steps, sweeps and Newton steps."""
    columns = list(dict.fromkeys(name for row in rows for name in row["ours"]))
    defaults = [name for name in columns if name.endswith(" default")]
    others = [name for name in columns if name not in defaults]
    precisions = _both(name.split()[0] for name in defaults)
    head = ["scene", "contacts", *(f"us {name.split()[0]}" for name in defaults), "us MuJoCo same / own"]
    head += [f"{name.split()[0]} x (target)" for name in defaults] + [f"{name} x" for name in others]
    head += [f"unsolved % {precisions}", f"sweeps {precisions}", f"Newton steps {precisions}"]
    lines = []
    for row in rows:
        ours, theirs = row["ours"], row["theirs"]
        if not ours:
            lines.append([row["row"], row["note"]] + [""] * (len(head) - 2))
            continue
        first = next(iter(ours.values()))
        cells: list[object] = [row["row"], f"{first['contacts']:.1f}", *(f"{ours[name]['microseconds']:.2f}" for name in defaults)]
        cells += [_both(f"{theirs[peer]['microseconds']:.1f}" for peer in PEERS)]
        cells += [_reached(ours[name]["ratio"], row["target"][name.split()[0]]) for name in defaults]
        cells += [f"{ours[name]['ratio']:.1f}" for name in others]
        cells += [_both(_percent(ours[name]["unsolved"]) for name in defaults)]
        cells += [_both(f"{ours[name][count]:.1f}" for name in defaults) for count in ("sweeps", "newton_steps")]
        lines.append(cells)
    cells = ["**geometric mean**", "", *("" for _ in defaults), ""]
    cells += [_reached(means(rows, name) or 0.0, target) for name, target in zip(defaults, _targets(defaults), strict=True)]
    cells += [f"**{means(rows, name):.1f}**" for name in others] + ["", "", ""]
    return _table(head, [*lines, cells])


def _targets(defaults: Sequence[str]) -> list[float]:
    return [dict(zip(("f64", "f32"), MEAN, strict=True))[name.split()[0]] for name in defaults]


def _reached(ratio: float, target: float) -> str:
    return f"**{ratio:.2g}** ({target:g})"


def _percent(share: float) -> str:
    text = f"{100 * share:.2g}"
    return text if share <= UNSOLVED else f"**{text}**"


def accuracy(rows: Sequence[Row]) -> str:
    """Contacts, penetration and slip of every engine and setting."""
    columns = list(dict.fromkeys(name for row in rows for name in row["ours"]))
    every = _both([*columns, "MuJoCo same", "own"])
    lines = []
    for row in rows:
        found = [*row["ours"].values(), *row["theirs"].values()]
        if not row["ours"]:
            continue
        cells = [row["row"], _both(f"{f['contacts']:.1f}" for f in found), _both(_mm(f["penetration"]) for f in found)]
        cells += [_both(_slip(f["slip"]) for f in found) if found[0]["slip"] else ""]
        gave_up = [f"{name} {f['failed']} of {f['environments']}" for name, f in row["theirs"].items() if f["failed"]]
        gave_up += [f"{name} {f['non_finite']} steps" for name, f in row["ours"].items() if f["non_finite"]]
        cells += ["; ".join([row["note"]] * bool(row["note"]) + gave_up)]
        lines.append(cells)
    return f"Columns: {every}.\n\n" + _table(["scene", "contacts", "deepest penetration mm", "slip mm", "remarks"], lines)


def show(rows: Sequence[Row]) -> str:
    """Both tables of every number of environments."""
    parts = []
    for num_envs in sorted({row["num_envs"] for row in rows}):
        some = [row for row in rows if row["num_envs"] == num_envs]
        parts.append(f"### {num_envs} environments\n\n{speed(some)}\n\n{accuracy(some)}")
    return "\n\n".join(parts)
