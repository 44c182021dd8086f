"""Figures of the documentation, computed from the result files in docs/benchmarks.

    python docs/hooks/figures.py            # names and values
    python docs/hooks/figures.py --update-docs   # write them into the README and the pages

Pages have each figure between `<!-- figure NAME -->` and `<!-- end -->`, so that they read well in the repository and on the site.
tests/test_documents.py compares them with the result files.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path
from statistics import geometric_mean
from typing import Any

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "docs/benchmarks"
FIGURE = re.compile(r"(<!-- figure ([a-z][\w.]*) -->).*?(<!-- end -->)", re.DOTALL)
"""Mark of a figure on a page, the figure, and the end mark."""
SHOWN = ("gymnasium humanoid", "gymnasium half_cheetah", "dm_control humanoid", "dm_control quadruped", "robosuite panda")
"""Robots of the README's table; the mean is of all."""
CREEP = (
    ("3", "incline of 10 degrees, mu 1"),
    ("31", "pinch at 1.01 of a cube, mu 0.5, 20 iterations"),
    ("32", "tray, 2 N at 0.99 mu N, mu 1.0"),
)
"""Scenes of the atlas in which a body must not move, by number and name."""
ATLAS_ENGINES = ("stepper", "MuJoCo", "MuJoCo tuned", "rapier")
PEERS = ("MuJoCo implicitfast, elliptic", "MuJoCo defaults")


def figures() -> dict[str, str]:
    """Values by the name that pages use."""
    speed = json.loads((BENCHMARKS / "results/speed.json").read_text())
    rows = speed["models"]
    found = {
        "speed.table": speed_table(rows),
        "speed.machine": machine(speed["provenance"]),
        "speed.command": speed["provenance"]["command"],
        "speed.robots": str(len(rows)),
    }
    for name, key in (("f64", "stepper f64"), ("f32", "stepper f32"), ("fast.f64", "stepper f64 fast"), ("fast.f32", "stepper f32 fast")):
        found[f"speed.{name}"] = f"{geometric_mean(row['ratio'][key] for row in rows):.1f}"
    found["speed.alone"] = f"{geometric_mean(row['ratio_alone']['stepper f64'] for row in rows):.1f}"
    found |= many_contacts()
    corpus = read_csv("corpus.csv")
    found["corpus.files"] = f"{len(corpus):,}"
    found["corpus.packages"] = str(len({row["package"] for row in corpus}))
    atlas = read_csv("atlas.csv")
    found["atlas.scenes"] = str(len({row["number"] for row in atlas}))
    found["atlas.creep"] = atlas_table(atlas, CREEP, "0.002")
    found["readme.table"] = readme_table(found)
    found["reality.cube"] = cube_table(read_csv("reality.csv"))
    found["reality.parameters"] = parameter_table(read_csv("reality.csv"))
    found["reality.elbow"] = cube_table(read_csv("reality_elbow.csv"))
    found["reality.elbow.parameters"] = parameter_table(read_csv("reality_elbow.csv"))
    found["reality.pendulum"] = pendulum_table(read_csv("reality_pendulum.csv"))
    found["reality.pairs"] = pair_table(read_csv("reality_pairs.csv"))
    found["calibration.certificates"] = certificate_table(read_csv("calibration.csv"))
    found["calibration.weaker"] = weaker_table(read_csv("calibration_weaker.csv"))
    found["readme.cube"] = readme_cube(read_csv("reality.csv"))
    found["published.grasp"] = grasp_table([*read_csv("published_grasp.csv"), *read_csv("published_grasp_published_scene.csv")])
    found["published.piles"] = plain_table(read_csv("published_piles_small.csv"), PILES)
    found["published.go1"] = plain_table(read_csv("published_go1.csv"), GO1)
    return found


def read_csv(name: str) -> list[dict[str, str]]:
    """Rows of a result file; lines that begin with # are notes."""
    lines = [line for line in (BENCHMARKS / name).read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def atlas_table(rows: list[dict[str, str]], scenes: tuple[tuple[str, str], ...], dt: str) -> str:
    """Errors of some scenes of the atlas at one time step, by engine."""
    cells = {(row["number"], row["name"], row["engine"]): row for row in rows if row["dt"] == dt}
    lines = ["| scene of the atlas | unit | " + " | ".join(ATLAS_ENGINES) + " |", "|---|---" + "|---:" * len(ATLAS_ENGINES) + "|"]
    for number, name in scenes:
        own = [cells[number, name, engine] for engine in ATLAS_ENGINES]
        errors = [row["outcome"] if row["outcome"] == "cannot run" else f"{float(row['error']):.1e}" for row in own]
        lines.append(f"| {number} {name} | {own[0]['unit']} | " + " | ".join(errors) + " |")
    return "\n".join(lines)


def machine(provenance: dict[str, Any]) -> str:
    """Processor, versions and date of a measurement, in words."""
    versions = provenance["versions"]
    return f"{provenance['cpu']}, CPU level {provenance['cpu_level']}, MuJoCo {versions['mujoco-core']}, {provenance['utc'][:10]}"


def many_contacts() -> dict[str, str]:
    """Ratios of the scenes with many contacts, from the table of targets in many_contacts.md."""
    text = (BENCHMARKS / "many_contacts.md").read_text()
    found = {}
    for name, row in (("mean", "geometric mean over scenes"), ("least", "smallest over scenes")):
        line = next(line for line in text.splitlines() if line.startswith(f"| {row}"))
        f64, f32 = re.findall(r"[\d.]+", line.split("|")[3])
        found |= {f"many.{name}.f64": f64, f"many.{name}.f32": f32}
    # "AMD EPYC, CPU level avx512, 2026-11-25; stepper 0.1.0, ..."
    found["many.machine"] = re.search(r"^(.*, CPU level \w+), \d{4}-\d\d-\d\d; ", text, re.MULTILINE)[1]  # type: ignore[index]
    return found


def speed_cells(row: dict[str, Any]) -> list[str]:
    """Cells of a robot: steps per second, ratios, penetration."""
    us, penetration = row["microseconds"], row["penetration"]
    peer = min(us[name] for name in PEERS)
    return [
        row["model"],
        *(f"{1e6 / value:,.0f}" for value in (us["stepper f64"], us["stepper f32"], peer)),
        *(f"{row['ratio'][name]:.1f}" for name in ("stepper f64", "stepper f32")),
        f"{1e3 * penetration['stepper f64']:.2g}",
        f"{1e3 * min(penetration[name] for name in PEERS):.2g}",
        f"{row['certificates']['stepper f64']['worst_residual']:.0e}",
    ]


def speed_table(rows: list[dict[str, Any]]) -> str:
    """Steps per second of one core, ratios, penetration and residual of every robot, and the mean of the ratios."""
    heads = ["robot, one core", "steps/s f64", "steps/s f32", "MuJoCo steps/s", "ratio f64", "ratio f32"]
    heads += ["penetration mm", "MuJoCo's, mm", "worst residual, m/s"]
    lines = ["| " + " | ".join(heads) + " |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    lines += ["| " + " | ".join(speed_cells(row)) + " |" for row in rows]
    means = [f"**{geometric_mean(row['ratio'][name] for row in rows):.1f}**" for name in ("stepper f64", "stepper f32")]
    lines.append(f"| geometric mean of {len(rows)} |||| {means[0]} | {means[1]} ||||")
    return "\n".join(lines)


def readme_table(found: dict[str, str]) -> str:
    """Table of the README: some robots, the mean of all, and the scenes with many contacts.

    Args:
        found: Values of the other figures by name.
    """
    lines = found["speed.table"].splitlines()
    kept = [*lines[:2], *(line for name in SHOWN for line in lines if line.startswith(f"| {name} |")), lines[-1]]
    kept.append(f"| 17 scenes with many contacts, mean |||| {found['many.mean.f64']} | {found['many.mean.f32']} ||||")
    kept.append(f"| the slowest of them, a wall that a ball hits |||| {found['many.least.f64']} | {found['many.least.f32']} ||||")
    kept.append("")
    kept.append(f"{found['speed.machine']}: `python benches/comparison/{found['speed.command']}`.")
    kept.append(f"Scenes with many contacts: {found['many.machine']}, `make many-contacts`.")
    return "\n".join(kept)


STEPS = ("0.00675676", "0.00168919", "0.000675676")
"""Time steps of the tosses in reality.csv, s."""


def _cube(rows: list[dict[str, str]], nuisances: str) -> dict[str, list[dict[str, str]]]:
    """Rows of the held-out tosses over their whole length, by engine, at the time steps `STEPS`."""
    found: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        if row["half"] == "held out" and not row["horizon_s"] and row["nuisances"] == nuisances:
            found.setdefault(row["engine"], []).append(row)
    return found


def interval(row: dict[str, str], name: str) -> str:
    """Value with its interval."""
    return f"{float(row[name]):.3f} ({float(row[f'{name}_low']):.3f} to {float(row[f'{name}_high']):.3f})"


def cube_table(rows: list[dict[str, str]]) -> str:
    """Errors of held-out tosses by engine, at all time steps."""
    errors = "mean error, time step 1/148 s | 1/592 s | 1/1480 s | median error, 1/1480 s | position error | orientation error"
    lines = [f"| nuisance parameters | engine | {errors} |"]
    lines.append("|---|---|---:|---:|---:|---:|---:|---:|")
    for nuisances in ("none", "fitted"):
        for engine, own in _cube(rows, nuisances).items():
            by_step = {row["timestep_s"]: row for row in own}
            coarse, middle, fine = (by_step[step] for step in STEPS)
            cells = [f"{float(coarse['mean']):.3f}", f"{float(middle['mean']):.3f}", interval(fine, "mean"), interval(fine, "median")]
            cells = ["diverges" if cell == "nan" else cell for cell in cells]
            cells += [f"{float(fine['distance_percent']):.1f} %", f"{float(fine['angle_deg']):.1f} deg"]
            lines.append(f"| {_values(nuisances)} | {engine} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _values(nuisances: str) -> str:
    """Cell that says whether nuisance parameters were fitted."""
    return "nominal" if nuisances == "none" else nuisances


def parameter_table(rows: list[dict[str, str]]) -> str:
    """Fitted parameters by engine."""
    lines = ["| nuisance parameters | engine | fitted values |", "|---|---|---|"]
    for nuisances in ("none", "fitted"):
        lines += [f"| {_values(nuisances)} | {engine} | {own[0]['parameters']} |" for engine, own in _cube(rows, nuisances).items()]
    return "\n".join(lines)


def pendulum_table(rows: list[dict[str, str]]) -> str:
    """Median errors of held-out predictions by pendulum and engine, at each horizon."""
    own = [row for row in rows if row["part"] == "held out"]
    horizons = list(dict.fromkeys(row["horizon_s"] for row in own))
    lines = [
        "| pendulum | engine | predictions | "
        + " | ".join(f"error after {horizon} s" for horizon in horizons)
        + " | fitted joint friction |"
    ]
    lines.append("|---|---|---:" + "|---:" * len(horizons) + "|---|")
    for name, engine in dict.fromkeys((row["pendulum"], row["engine"]) for row in own):
        some = [row for row in own if (row["pendulum"], row["engine"]) == (name, engine)]
        cells = [name, engine, some[0]["predictions"], *(f"{float(row['median_rad']):.4f}" for row in some), some[0]["parameters"]]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def pair_table(rows: list[dict[str, str]]) -> str:
    """Paired differences of engines in the mean error of held-out tosses."""
    lines = ["| object | nuisance parameters | first engine | second engine | difference of mean errors, 95 % |", "|---|---|---|---|---:|"]
    for row in rows:
        interval = "{:.3f} ({:.3f} to {:.3f})".format(*(float(row[name]) for name in ("more", "low", "high")))
        cells = [row["data_set"].removesuffix("_toss"), _values(row["nuisances"]), row["engine"], row["other"], interval]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def certificate_table(rows: list[dict[str, str]]) -> str:
    """Certificates of robots: tolerances, and worlds that exceed the margin."""
    lines = ["| task | contact | margin | measured, to ± | worlds above the margin | confidence | without measurements |"]
    lines.append("|---|---|---:|---|---:|---:|---:|")
    for row in rows:
        cells = [row["task"], row["law"], row["margin"], row["measured"], f"{row['violations']} of {row['worlds']}"]
        cells += [f"{100 * float(row['confidence']):.1f} %", f"{row['unmeasured']} of {row['worlds']}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def weaker_table(rows: list[dict[str, str]]) -> str:
    """Weaker alternatives of certificates that surely fail, that pass, and others, by task, with their worlds above the margin."""
    lines = ["| task | contact | surely fails | passes | not decided |", "|---|---|---|---|---|"]
    for task, law in dict.fromkeys((row["task"], row["law"]) for row in rows):
        cells: tuple[list[str], ...] = ([], [], [])
        for row in rows:
            if (row["task"], row["law"]) == (task, law):
                which = 0 if float(row["least"]) > 0.05 else 1 if float(row["greatest"]) <= 0.05 else 2
                cells[which].append(f"{row['set']}: {row['violations']} of {int(row['worlds']):,}")
        lines.append(f"| {task} | {law} | " + " | ".join("; ".join(cell) or "-" for cell in cells) + " |")
    return "\n".join(lines)


def readme_cube(rows: list[dict[str, str]]) -> str:
    """Median and mean errors of held-out tosses as published, by engine, as one line. The smallest median is first."""
    cells = []
    for engine, own in _cube(rows, "none").items():
        fine = next(row for row in own if row["timestep_s"] == STEPS[-1])
        cells.append((float(fine["median"]), f"{engine} {float(fine['median']):.3f} ({float(fine['mean']):.3f})"))
    return "; ".join(text for _, text in sorted(cells))


PILES = {
    "scene": "pile", "bodies": "bodies", "engine": "engine", "steps": "steps", "first_ms": "first step, ms", "ms_per_step": "ms per step",
    "total_ms": "in total, ms", "contacts": "contacts at the end", "largest_sinking_m": "deepest fall, m",
}  # fmt: skip
GO1 = {"engine": "engine", "steps_per_core_s": "steps per core second", "height_m": "mean height at the end, m"}
"""Columns of the published tables, rerun: name in the result file, and on the page."""


def plain_table(rows: list[dict[str, str]], columns: dict[str, str]) -> str:
    """Some columns of a result file; numbers have three digits, counts all."""

    def cell(text: str) -> str:
        if not re.fullmatch(r"-?[\d.]+(e[+-]\d+)?", text):
            return text
        return f"{int(text):,}" if text.isdigit() else f"{float(f'{float(text):.3g}'):,g}"

    lines = ["| " + " | ".join(columns.values()) + " |", "|---" * len(columns) + "|"]
    lines += ["| " + " | ".join(cell(row[name]) for name in columns) + " |" for row in rows]
    return "\n".join(lines)


def grasp_table(rows: list[dict[str, str]]) -> str:
    """Drop of the block, mm, by scene and engine, at each factor of the critical friction."""
    factors = list(dict.fromkeys(row["factor"] for row in rows))
    lines = ["| scene | engine | grip, N | " + " | ".join(f"{float(factor):.2f}" for factor in factors) + " |"]
    lines.append("|---|---|---:" + "|---:" * len(factors) + "|")
    for scene, engine in dict.fromkeys((row["scene"], row["engine"]) for row in rows):
        own = [row for row in rows if (row["scene"], row["engine"]) == (scene, engine)]
        cells = [scene, engine, f"{float(own[0]['force_N']):.2f}", *(f"{abs(float(row['drop_mm'])):.1f}" for row in own)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def with_figures(text: str, values: dict[str, str], place: str) -> str:
    """Text of a page with the present values of its figures.

    Args:
        text: Text of the page.
        values: Values by name.
        place: Path of the page, for messages.

    Raises:
        KeyError: A name is unknown.
    """

    def figure(match: re.Match[str]) -> str:
        if match[2] not in values:
            raise KeyError(f"{place} has the figure {match[2]}, which docs/hooks/figures.py does not have; it lists its names")
        value = values[match[2]]
        return match[1] + (f"\n\n{value}\n\n" if "\n" in value else value) + match[3]

    return FIGURE.sub(figure, text)


def pages() -> list[Path]:
    """Files that may have figures."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def main() -> None:
    """Print all figures, or write them into the pages."""
    values = figures()
    if "--update-docs" in sys.argv:
        for page in pages():
            page.write_text(with_figures(page.read_text(), values, str(page)))
        return
    for name, value in values.items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    main()
