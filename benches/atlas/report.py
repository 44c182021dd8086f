"""Report of a sweep: docs/benchmarks/atlas.md with a page for each group of scenes in docs/benchmarks/atlas/."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from rows import provenance_section
from stepper.lab.study.document import markdown_table

from atlas.known import failure
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
    (folder / "atlas.md").write_text("".join([*parts, "\n", provenance_section(provenance)]), encoding="utf-8")


def _number(x: float) -> str:
    """Text of a number with one significant digit."""
    if math.isnan(x):
        return ""
    if math.isinf(x):
        return "inf"
    return "0" if x == 0 else f"{x:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def _summary(scenes: Sequence[Scene], engines: Sequence[str], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Table with the number of passed time steps and the error, by scene and engine."""
    lines = []
    totals = dict.fromkeys(engines, 0)
    for scene in scenes:
        usual = min(scene.dts, key=lambda dt: abs(math.log(dt / USUAL)))
        cells = [scene.title, scene.unit]
        for engine in engines:
            runs = [by[scene.number, scene.name, dt, engine] for dt in scene.dts]
            held = sum(r.outcome == HELD for r in runs)
            totals[engine] += held
            mark = "**" if held == len(runs) else ""
            error = _number(by[scene.number, scene.name, usual, engine].error)
            cells.append("-" if all(r.outcome == CANNOT for r in runs) else f"{mark}{held}/{len(runs)}{mark} {error}")
        lines.append(cells)
    lines.append([f"all, of {sum(len(scene.dts) for scene in scenes)}", "", *(f"**{totals[e]}**" for e in engines)])
    return markdown_table(["scene", "unit", *engines], lines) + "\n"


def _reasons(scenes: Sequence[Scene], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Section with the reasons for failures of stepper, and the settings and time steps of each scene that fails."""
    found: dict[str, dict[str, list[str]]] = {}
    for scene in scenes:
        for row in (r for (number, name, _, _), r in by.items() if (number, name) == (scene.number, scene.name)):
            if row.engine.startswith("stepper") and row.outcome != HELD:
                known = failure(scene.title, row.engine, row.dt)
                why = known.reason if known else next(iter(row.note.splitlines()), "not explained yet")
                setting = row.engine.removeprefix("stepper").strip() or "default"
                found.setdefault(why, {}).setdefault(scene.title, []).append(f"{setting}, {row.dt * 1e3:g} ms")
    text = "\n## Failures of stepper and their reasons\n\n" + ("" if found else "None.\n")
    for why, runs in found.items():
        text += f"* {why}\n" + "".join(f"    * {title}: {'; '.join(settings)}\n" for title, settings in runs.items())
    return text


def _answers(scenes: Sequence[Scene]) -> str:
    """Section with the right answer of each scene, its source and its tolerance."""
    head = ["scene", "right answer", "source", "tolerance at 2 ms", "reason of the tolerance"]
    lines = ([s.title, s.answer, s.source, f"{_number(s.tolerance(USUAL))} {s.unit}", s.because] for s in scenes)
    return f"\n## Right answers and tolerances\n\n{markdown_table(head, lines)}\n"


def _all(scenes: Sequence[Scene], engines: Sequence[str], by: Mapping[tuple[str, str, float, str], Row]) -> str:
    """Section with the results of all runs."""
    lines = []
    for scene in scenes:
        for dt in scene.dts:
            rows = (by[scene.number, scene.name, dt, engine] for engine in engines)
            marks = (
                "-" if r.outcome == CANNOT else f"{'+' if r.outcome == HELD else 'x'} {_number(r.error)}; {r.cost * 1e3:.2g}" for r in rows
            )
            lines.append([scene.title, f"{dt * 1e3:g}", *marks])
    title = "All runs: holds (+) or fails (x), error; cost in ms of one core per simulated second"
    return f"\n## {title}\n\n{markdown_table(['scene', 'dt, ms', *engines], lines)}\n"
