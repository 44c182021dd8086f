"""Demo (`stepper demo`): a thousand humanoids fall and come to rest in stepper and in MuJoCo, with speed and errors in one table."""

from __future__ import annotations

import dataclasses
import functools
import json
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from stepper.lab.demo.race import MATCHED, Plan, Referee, Track, humanoid_path, race, random_control
from stepper.lab.engines import EngineBatch, MujocoBatch, StepperBatch
from stepper.lab.study.document import markdown_table
from stepper.loading import load
from stepper.shared.files import locked, write_text
from stepper.shared.machine import one_core, provenance
from stepper.shared.progress import ProgressCallback, show_files, show_progress

Figures = dict[str, Any]
"""Results of the demo or of one engine, by name. Speeds have one number for each phase of the race, "control" and "rest"."""


def measure(plan: Plan, progress: ProgressCallback) -> Figures:
    """Runs the race of the humanoids on one core.

    Returns:
        Results of all engines, and settings, as values that JSON can represent.
    """
    path = humanoid_path()
    model, control, referee = load(path), random_control(path, plan), Referee(path)
    with one_core():
        batches: list[EngineBatch] = [
            StepperBatch(model, plan.num_envs),
            StepperBatch(model, plan.num_envs, precision="f32"),
            MujocoBatch.from_file(path, plan.num_peers, settings=MATCHED),
            MujocoBatch.from_file(path, plan.num_peers),
        ]
        tracks = race(batches, control, plan, clock=time.process_time, progress=progress, what="one core", referee=referee)
    peers = {batch.name: tracks[batch.name] for batch in batches if isinstance(batch, MujocoBatch)}
    return {
        "model": "dm_control/suite/humanoid.xml",
        "plan": dataclasses.asdict(plan) | {"peers": plan.num_peers},
        "engines": {batch.name: _figures(batch, tracks[batch.name], peers) for batch in batches},
        "provenance": provenance(),
    }


def _figures(batch: EngineBatch, track: Track, peers: dict[str, Track]) -> Figures:
    """Results of one engine: speeds (medians over the turns of the race), contacts, penetration and energy."""
    samples = track.samples["control"] + track.samples["rest"]
    phases = {phase: times for phase, times in track.times.items() if times}
    figures: Figures = {
        "num_envs": batch.num_envs,
        "steps_per_second": {phase: 1e6 / median(times) for phase, times in phases.items()},
        "ratio": {name: {phase: _ratio(times, theirs.times[phase]) for phase, times in phases.items()} for name, theirs in peers.items()},
        "worst_penetration": max(sample.penetration for sample in samples),
        "at_the_end": dataclasses.asdict(samples[-1]),
    }
    if isinstance(batch, StepperBatch):
        figures["solver_statistics"] = {phase: dataclasses.asdict(statistics) for phase, statistics in batch.solver_statistics.items()}
    return figures


def _ratio(ours: list[float], theirs: list[float]) -> float:
    """Median over the turns of the ratio of another engine's time to ours."""
    return median(their / our for our, their in zip(ours, theirs, strict=True))


def table(figures: Figures) -> str:
    """Markdown table of the results of `measure`, with a column for each engine."""
    engines: dict[str, Figures] = figures["engines"]
    cells: dict[str, Callable[[Figures], str]] = {
        "environments": lambda own: f"{own['num_envs']:,}",
        "steps per second of one core, control / rest": lambda own: _phases(own["steps_per_second"], ",.0f"),
        **{f"times {peer}": functools.partial(_times, peer) for peer in next(iter(engines.values()))["ratio"]},
        "largest penetration, mm": lambda own: f"{1e3 * own['worst_penetration']:.2g}",
        "penetration at the end, mm": lambda own: f"{1e3 * own['at_the_end']['penetration']:.2g}",
        "kinetic energy at the end, J": lambda own: f"{own['at_the_end']['kinetic_mean']:.2g}",
        "worst residual of a step, m/s": lambda own: _of_steps(own, "worst_residual", "{:.1e}"),
        "steps not converged": lambda own: _of_steps(own, "not_converged", "{:,}"),
    }
    rows = [[label, *map(cell, engines.values())] for label, cell in cells.items()]
    return markdown_table(["", *engines], rows)


def _times(peer: str, figures: Figures) -> str:
    """Text of an engine's speed relative to that of a peer, by phase."""
    return _phases(figures["ratio"][peer], ".2f")


def _phases(values: dict[str, float], form: str) -> str:
    """Text with one number for each phase of the race ("control", "rest"), in a format such as ".2f"."""
    return " / ".join(format(value, form) for value in values.values())


def _of_steps(figures: Figures, name: str, form: str) -> str:
    """Text of a statistic of the solver by phase; a dash for MuJoCo, which reports none."""
    return " / ".join(form.format(own[name]) for own in figures.get("solver_statistics", {}).values()) or "-"


def demo(plan: Plan, out: Path) -> Figures:
    """Runs the demo: prints the table, and writes `demo.json`.

    Returns:
        Results and settings, as returned by `measure`.
    """
    with locked(out):
        with show_progress() as progress:
            figures = measure(plan, progress)
        file = write_text(out / "demo.json", json.dumps(figures, indent=2) + "\n")
    came_from = figures["provenance"]
    print(table(figures))
    print(f"Humanoids that fall under random controls for {plan.steps} steps, and rest for {plan.rest}. Engines take turns on one core")
    print(f"of {came_from['cpu']}, load {came_from['load_average']}; speeds are medians over the turns.")
    print(f"Penetration and energy are those of the first {plan.num_peers} humanoids, by MuJoCo's collision detection and inertia.")
    show_files([file])
    return figures
