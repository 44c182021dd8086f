"""Report of a sweep: docs/benchmarks/atlas.md with a page for each group of scenes in docs/benchmarks/atlas/, and atlas.csv."""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path

from atlas.known import reason
from atlas.run import CANNOT, HELD, Row
from atlas.scene import Scene

USUAL = 2e-3
"""Time step of the atlas's summary, s. The summary has the error of each scene at the scene's time step that is nearest to this value."""

MAIN = ("stepper", "stepper fine", "stepper f32", "MuJoCo", "MuJoCo tuned", "rapier")
"""Engines of the summary, which the pages of the groups compare with all others."""

HEAD = """# The failure atlas

Scenes with known answers where methods fail: 44 numbered scenes, and the seven public tests of SimBenchmark (S1 to S7) with its
parameters. Every right answer is a closed form, statics or a conservation law, never another simulator. A scene *holds* at a time step
if the error of the engine is within the tolerance of the scene.
`make atlas` runs all scenes and writes this page, the pages of the groups, [atlas.csv](atlas.csv) and the figure; `tests/failure/` runs a
shorter sweep.

![Share of the runs that hold, by engine](atlas.png)

Engines:

* **stepper** has the default `Options()`.
* **stepper f32** has `precision="f32"`. **stepper euler**, **rk4** and **implicit** have this `integrator`, **baumgarte** this
  `stabilization`, and **newton** this `solver`. **stepper fine** has `tolerance=1e-6`.
* **MuJoCo's law in stepper** has `Options(contact="mujoco", integrator="euler")`: the contact law of MuJoCo.
* **MuJoCo** has default settings. MuJoCo has no coefficient of restitution, so its default cannot reproduce a bounce.
* **MuJoCo tuned** has the settings of MuJoCo's guide for contact without slip: elliptic cones, impratio 100, the integrator implicitfast,
  and a time constant of two steps in solref. In scenes with restitution, solref has stiffness and damping instead.
* **MuJoCo tuned, discrete** has the integrator discrete and impratio 10.
* **rapier** is the Python wheel with its defaults, in 32 bits.

In the tables, "4/5 2e-10" means: the scene holds at 4 of 5 time steps, and the error is 2e-10 at the step nearest to 2 ms. "-" means that
the engine cannot run the scene.

## Pages of the groups

Each group of scenes has a page with all engines, the reasons of stepper's failures, right answers and all runs.

"""


def write_csv(path: Path, rows: Sequence[Row], provenance: Mapping[str, object]) -> None:
    """Write all rows as CSV, below comment lines with their provenance."""
    with path.open("w", newline="", encoding="utf-8") as file:
        for key, value in provenance.items():
            file.write(f"# {key}: {json.dumps(value)}\n")
        writer = csv.writer(file)
        writer.writerow(f.name for f in fields(Row))
        writer.writerows([f"{v:.4g}" if isinstance(v, float) else v for v in asdict(row).values()] for row in rows)


def read_csv(path: Path) -> tuple[list[Row], dict[str, object]]:
    """Rows and provenance from a file of `write_csv`."""
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = {key: json.loads(value) for key, value in (line[2:].split(": ", 1) for line in lines if line.startswith("# "))}
    numbers = {"dt", "error", "tolerance", "cost"}
    rows = []
    for record in csv.DictReader(line for line in lines if not line.startswith("# ")):
        rows.append(Row(**{k: float(v) if k in numbers else v for k, v in record.items()}))
    return rows, notes


def write_markdown(
    folder: Path, groups: Mapping[str, tuple[str, Sequence[Scene]]], rows: Sequence[Row], provenance: Mapping[str, object]
) -> None:
    """Write atlas.md, a summary of all scenes, and atlas/GROUP.md for each group: engines, stepper's failures, answers, all runs."""
    engines = list(dict.fromkeys(row.engine for row in rows))
    by = {(r.number, r.name, r.dt, r.engine): r for r in rows}
    known = {(r.number, r.name) for r in rows}
    (folder / "atlas").mkdir(exist_ok=True)
    parts = [HEAD, *(f"* [{title}](atlas/{name}.md)\n" for name, (title, _) in groups.items())]
    for name, (title, scenes) in groups.items():
        shown = [scene for scene in scenes if (scene.number, scene.name) in known]
        if not shown:
            continue
        main = [engine for engine in MAIN if engine in engines] or engines
        parts.append(f"\n## {title}\n\n{_summary(shown, main, by)}")
        text = f"# {title}\n\nScenes of the [failure atlas](../atlas.md), which describes the engines.\n\n"
        text += "## Number of time steps at which each scene holds, and the error at the step nearest to 2 ms\n\n"
        text += _summary(shown, engines, by)
        text += "\n".join([_reasons(shown, by), _answers(shown), _all(shown, engines, by)])
        (folder / f"atlas/{name}.md").write_text(text, encoding="utf-8")
    (folder / "atlas.md").write_text("".join([*parts, _provenance(provenance)]), encoding="utf-8")


def _line(cells: Sequence[str]) -> str:
    """Row of a Markdown table, from the texts of its cells."""
    return "| " + " | ".join(cells) + " |\n"


def _number(x: float) -> str:
    """Text of a number with one significant digit."""
    if math.isnan(x):
        return ""
    if math.isinf(x):
        return "inf"
    return "0" if x == 0 else f"{x:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def _summary(scenes: Sequence[Scene], engines: Sequence[str], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Table with the number of passed time steps and the error, by scene and engine."""
    text = _line(["scene", "unit", *engines]) + _line(["---"] * (len(engines) + 2))
    totals = dict.fromkeys(engines, 0)
    for scene in scenes:
        usual = min(scene.dts, key=lambda dt: abs(math.log(dt / USUAL)))
        cells = [scene.title, scene.unit]
        for engine in engines:
            runs = [by[scene.number, scene.name, dt, engine] for dt in scene.dts]
            held = sum(r.outcome == HELD for r in runs)
            totals[engine] += held
            if all(r.outcome == CANNOT for r in runs):
                cells.append("-")
                continue
            mark = "**" if held == len(runs) else ""
            cells.append(f"{mark}{held}/{len(runs)}{mark} {_number(by[scene.number, scene.name, usual, engine].error)}")
        text += _line(cells)
    runs = sum(len(scene.dts) for scene in scenes)
    return text + _line([f"all, of {runs}", "", *(f"**{totals[e]}**" for e in engines)])


def _reasons(scenes: Sequence[Scene], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Section with the reasons for failures of stepper."""
    found: dict[str, list[str]] = {}
    for scene in scenes:
        for row in (r for (number, name, _, _), r in by.items() if (number, name) == (scene.number, scene.name)):
            if row.engine.startswith("stepper") and row.outcome != HELD:
                why = reason(scene.title, row.engine, row.dt) or row.note.splitlines()[0:1] or ["not explained yet"]
                why = why if isinstance(why, str) else why[0]
                found.setdefault(why, []).append(
                    f"{scene.title} ({row.engine.removeprefix('stepper').strip() or 'default'}, {row.dt * 1e3:g} ms)"
                )
    text = "\n## Failures of stepper and their reasons\n\n" + ("" if found else "None.\n")
    for why, where in found.items():
        text += f"* {why}\n" + "".join(f"    * {line}\n" for line in _grouped(where))
    return text


def _grouped(where: Sequence[str]) -> list[str]:
    """Lines of text, one for each scene, which list all failures of the scene."""
    lines: dict[str, list[str]] = {}
    for entry in where:
        title, _, rest = entry.rpartition(" (")
        lines.setdefault(title, []).append(rest.rstrip(")"))
    return [f"{title}: {'; '.join(rest)}" for title, rest in lines.items()]


def _answers(scenes: Sequence[Scene]) -> str:
    """Section with the right answer of each scene, its source and its tolerance."""
    text = "\n## Right answers and tolerances\n\n"
    text += _line(["scene", "right answer", "source", "tolerance at 2 ms", "reason of the tolerance"]) + _line(["---"] * 5)
    for s in scenes:
        text += _line([s.title, s.answer, s.source, f"{_number(s.tolerance(USUAL))} {s.unit}", s.because])
    return text


def _all(scenes: Sequence[Scene], engines: Sequence[str], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Section with the results of all runs."""
    text = "\n## All runs: holds (+) or fails (x), error; cost in ms of one core per simulated second\n\n"
    text += _line(["scene", "dt, ms", *engines]) + _line(["---"] * (len(engines) + 2))
    for scene in scenes:
        for dt in scene.dts:
            cells = [scene.title, f"{dt * 1e3:g}"]
            for engine in engines:
                row = by[scene.number, scene.name, dt, engine]
                if row.outcome == CANNOT:
                    cells.append("-")
                else:
                    cells.append(f"{'+' if row.outcome == HELD else 'x'} {_number(row.error)}; {row.cost * 1e3:.2g}")
            text += _line(cells)
    return text


def _provenance(provenance: Mapping[str, object]) -> str:
    """Section with machine, versions and time of the measurement."""
    text = "\n## Provenance\n\n"
    return text + "".join(f"* {key}: {value if isinstance(value, str) else json.dumps(value)}\n" for key, value in provenance.items())
