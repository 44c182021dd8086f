"""Comparison (`stepper.lab.compare`) of the same episodes with hard contact, with MuJoCo's contact law and in MuJoCo."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.lab.study.document import markdown_table
from stepper.lab.study.worlds import Plan, World, make_world
from stepper.loading import Origin, compile_source, is_saved, load
from stepper.shared.arguments import check_number, check_whole
from stepper.shared.files import write_figure
from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, silent

Array = NDArray[np.float64]
ONSET = 1e-3
"""Difference of a position above which two motions count as different, rad or m."""
_HOLD = 0.02
"""Time for which a random control is held, s."""


@dataclass(frozen=True)
class Course:
    """Recorded run of one engine, with values after every step in every environment.

    Attributes:
        name: Name of the engine.
        timestep: Time step, s.
        qpos: Positions after every step, (steps, num_envs, nq), m and rad.
        depth: Deepest overlap, (steps, num_envs), m.
        overshoot: Largest violation of a limit, (steps, num_envs), rad or m.
        energy: Potential and kinetic energy after every step, (steps, num_envs), J.
        force: Largest normal force of a contact, (steps, num_envs), N.
        impulse: Sum of normal impulses, (steps, num_envs), N s.
        pairs: Number of pairs of geoms that touch, (steps, num_envs).
        begins: Number of pairs that touch and did not touch in the previous step, (steps, num_envs).
    """

    name: str
    timestep: float
    qpos: Array
    depth: Array
    overshoot: Array
    energy: Array
    force: Array
    impulse: Array
    pairs: Array
    begins: Array


@dataclass(frozen=True)
class LawComparison:
    """Result of `compare`: recorded runs of the same episodes in several engines.

    Attributes:
        courses: Recorded runs of all episodes, one entry per contact law or engine. The first entry is stepper with hard contact.
    """

    courses: tuple[Course, ...]

    def figures(self) -> dict[str, dict[str, float]]:
        """Returns the values of the comparison table, as one dictionary for each engine, by name of the engine.

        Keys of an engine's dictionary are the headings of the table's rows, which include the units. Means are over environments.
        """
        return {course.name: self._figures(course) for course in self.courses}

    def _figures(self, course: Course) -> dict[str, float]:
        """Values of one engine in the comparison table, by heading of the table's row, which includes the unit."""
        apart = np.abs(course.qpos - self.courses[0].qpos).max(axis=2) > ONSET
        parted = np.where(apart.any(axis=0), (apart.argmax(axis=0) + 1) * course.timestep, np.inf)
        first = np.where((course.pairs > 0).any(axis=0), ((course.pairs > 0).argmax(axis=0) + 1) * course.timestep, np.inf)
        return {
            "largest penetration, mm": 1e3 * float(course.depth.max()),
            "mean of the largest penetration, mm": 1e3 * float(course.depth.mean()),
            "largest limit violation, rad or m": float(course.overshoot.max()),
            "energy at the end, J": float(course.energy[-1].mean()),
            "peak force of a contact, N": float(course.force.max()),
            "impulse of contacts, N s": float(course.impulse.sum(axis=0).mean()),
            "first touch, s": float(np.median(first)),
            "new touches": float(course.begins.sum(axis=0).mean()),
            "touching, fraction of time": float((course.pairs > 0).mean()),
            f"time until qpos differs from hard contact by {ONSET:g}, s": float(np.median(parted)),
        }

    def table(self) -> str:
        """Returns the comparison as a Markdown table, with a column for each engine and a row for each measured quantity."""
        figures = self.figures()
        names = list(figures)
        cells = {key: (figures[name][key] for name in names) for key in figures[names[0]]}
        rows = ([key, *("never" if np.isinf(x) else f"{x:.3g}" for x in own)] for key, own in cells.items())
        return markdown_table(["", *names], rows)

    def draw(self, path: str | Path) -> Path:
        """Writes a picture of overlap, force, energy and difference from hard contact against time.

        Raises:
            MissingPackageError: matplotlib is not installed.
        """
        return _draw(self.courses, Path(path))

    def __str__(self) -> str:
        return self.table()


def compare(
    source: Any, *, seconds: float = 2.0, num_envs: int = 8, seed: int = 0, progress: ProgressCallback | None = None
) -> LawComparison:
    """Runs the same episodes with hard contact, with MuJoCo's contact law, and in MuJoCo if it is installed.

    Episodes start at the reference pose with small random velocities, and have random controls. A study compares laws with a controller.

    Args:
        source: Source of the model, as for `stepper.load`. With a `Model` or a saved model, or if MuJoCo is not installed, the run in
            MuJoCo is left out.
        seconds: Length of an episode, s.
        num_envs: Number of episodes.
        seed: Seed of the random numbers.
        progress: Progress callback with the name of an engine and the fraction of its steps.

    Returns:
        The comparison: `print` shows its table, `LawComparison.draw` writes a picture.

    Raises:
        TypeError: An argument has another type.
        ValueError: A number is out of its range.
    """
    check_number("seconds", seconds, above=0.0)
    check_whole("num_envs", num_envs, least=1)
    check_whole("seed", seed, least=0)
    model, compiled = _load(source)
    timestep = float(Stepper(model).timestep)
    rng = np.random.default_rng(seed)
    qpos = np.tile(np.asarray(model.qpos0, float), (num_envs, 1))
    qvel = rng.normal(0.0, 0.01, (num_envs, model.nv))
    controls = _random(model, num_envs, max(1, round(seconds / timestep)), max(1, round(_HOLD / timestep)), rng)
    plans = {"hard": Plan(model, {}, Options()), "MuJoCo's law": Plan(model, {}, Options(contact="mujoco"))}
    if compiled is not None:
        plans["MuJoCo"] = Plan(model, {}, Options(), mujoco={"timestep": timestep}, compiled=compiled)
    courses = []
    for name, plan in plans.items():
        world = make_world(plan, num_envs)
        world.start(qpos, qvel, None, 0)
        courses.append(_run(name, world, controls, progress or silent))
    return LawComparison(tuple(courses))


def _load(source: Any) -> tuple[Model, Any]:
    """Model of a source, and its `mujoco.MjModel`.

    The latter is None if MuJoCo is not installed, or if the source is a `Model` or a saved model.
    """
    if isinstance(source, Model):
        return source, None
    if importlib.util.find_spec("mujoco") is None or is_saved(source):
        return load(source, strict=False), None
    compiled = compile_source(Origin(source))
    return load(compiled, strict=False), compiled


def _random(model: Model, num_envs: int, steps: int, hold: int, rng: np.random.Generator) -> Array:
    """Random controls within the actuators' ranges, (steps, num_envs, nu), each held for `hold` steps."""
    bounds = np.asarray(model.actuator_ctrlrange, float).reshape(model.nu, 2)
    low, high = np.where(np.isfinite(bounds), bounds, [-1.0, 1.0]).T
    drawn = rng.uniform(low, high, (steps // hold + 1, num_envs, model.nu))
    controls: Array = np.repeat(drawn, hold, axis=0)[:steps]
    return controls


def _run(name: str, world: World, controls: Array, progress: ProgressCallback) -> Course:
    """Steps the environments of an engine with controls (steps, num_envs, nu), and records every step."""
    rows: dict[str, list[Any]] = {key: [] for key in ("qpos", "depth", "overshoot", "energy", "force", "impulse", "pairs", "begins")}
    before: list[set[tuple[int, int]]] = [set() for _ in range(world.num_envs)]
    for k, ctrl in enumerate(controls):
        world.step(ctrl, 1)
        contacts = world.contacts()
        pushing = [contacts[(contacts["env"] == env) & (contacts["force"][:, 0] > 0.0)] for env in range(world.num_envs)]
        now = [{(int(a), int(b)) for a, b in own["geom"]} for own in pushing]
        rows["qpos"].append(np.array(world.qpos))
        rows["depth"].append([np.max(-own["distance"], initial=0.0) for own in pushing])
        rows["overshoot"].append(np.array(world.max_limit_violation))
        rows["energy"].append(np.sum(world.energy(), axis=0))
        rows["force"].append([np.max(own["force"][:, 0], initial=0.0) for own in pushing])
        rows["impulse"].append([world.timestep * own["force"][:, 0].sum() for own in pushing])
        rows["pairs"].append([len(pairs) for pairs in now])
        rows["begins"].append([len(pairs - old) for pairs, old in zip(now, before, strict=True)])
        before = now
        progress(name, (k + 1) / len(controls))
    return Course(name, world.timestep, **{key: np.array(value, float) for key, value in rows.items()})


def _draw(courses: Sequence[Course], path: Path) -> Path:
    """Draws overlap, force, energy and difference from hard contact against time, and returns the path of the picture.

    Lines are medians over episodes with the range between quartiles, in one colour per engine.
    """
    figure = require("matplotlib.figure", "to draw the comparison").Figure(figsize=(11, 7), layout="constrained")
    panels = figure.subplots(2, 2)
    hard = courses[0]
    for number, course in enumerate(courses):
        time = course.timestep * np.arange(1, len(course.depth) + 1)
        apart = np.abs(course.qpos - hard.qpos).max(axis=2)
        values = (1e3 * course.depth, course.force, course.energy, np.maximum(apart, 1e-12))
        for panel, value in zip(panels.flat, values, strict=True):
            low, middle, high = np.quantile(value, (0.25, 0.5, 0.75), axis=1)
            if panel is panels[1, 1] and course is hard:
                continue
            # The line of MuJoCo is dashed, because the line of MuJoCo's contact law in stepper is nearly the same.
            panel.plot(time, middle, "--" if number > 1 else "-", color=f"C{number}", label=course.name, linewidth=1.2)
            panel.fill_between(time, low, high, color=f"C{number}", alpha=0.2, linewidth=0)
    titles = (
        "largest penetration, mm",
        "largest normal force, N",
        "energy, J",
        "largest difference of the configuration from hard contact",
    )
    for panel, title in zip(panels.flat, titles, strict=True):
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("time, s")
        panel.grid(visible=True, alpha=0.3)
    panels[1, 1].set_yscale("log")
    panels[0, 0].legend()
    return write_figure(path, figure, dpi=130)
