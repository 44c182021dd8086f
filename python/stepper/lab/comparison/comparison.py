"""LawComparison (`stepper.lab.compare`) of the same episodes with hard contact, with MuJoCo's contact law and in MuJoCo."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stepper._arrays import array_of
from stepper._options import Options
from stepper._stepper import Model, Stepper
from stepper.lab.comparison.draw import draw
from stepper.lab.comparison.trial import Array, ControlSource, Course, Slip, run
from stepper.lab.study.document import markdown_table
from stepper.lab.study.worlds import Plan, make_world
from stepper.loading import Origin, compile_source, is_saved, load
from stepper.shared.arguments import check_kind, check_number, check_whole
from stepper.shared.functions import check_takes
from stepper.shared.progress import ProgressCallback, silent

ONSET = 1e-3
"""Difference of a position above which two motions count as different, rad or m."""


@dataclass(frozen=True)
class LawComparison:
    """Result of `compare`: recorded runs of the same episodes in several engines.

    Attributes:
        courses: Recorded runs of all episodes, one entry per contact law or engine. The first entry is stepper with hard contact.
        rewarded: Whether `compare` was called with a reward function.
    """

    courses: tuple[Course, ...]
    rewarded: bool

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
        out = {
            "largest penetration, mm": 1e3 * float(course.depth.max()),
            "mean of the largest penetration, mm": 1e3 * float(course.depth.mean()),
            "largest limit violation, rad or m": float(course.overshoot.max()),
            "energy at the end, J": float(course.energy[-1].mean()),
            "peak force of a contact, N": float(course.force.max()),
            "impulse of contacts, N s": float(course.impulse.sum(axis=0).mean()),
            "sliding distance of surfaces, m": float(course.slip.sum(axis=0).mean()),
            "first touch, s": float(np.median(first)),
            "new touches": float(course.begins.sum(axis=0).mean()),
            "touching, fraction of time": float((course.pairs > 0).mean()),
            f"time until qpos differs from hard contact by {ONSET:g}, s": float(np.median(parted)),
        }
        return out | ({"return": float(course.reward.sum(axis=0).mean())} if self.rewarded else {})

    def table(self) -> str:
        """Returns the comparison as a Markdown table, with a column for each engine and a row for each measured quantity."""
        figures = self.figures()
        names = list(figures)
        cells = {key: (figures[name][key] for name in names) for key in figures[names[0]]}
        rows = ([key, *("-" if np.isnan(x) else "never" if np.isinf(x) else f"{x:.3g}" for x in own)] for key, own in cells.items())
        return markdown_table(["", *names], rows)

    def draw(self, path: str | Path) -> Path:
        """Writes a picture of overlap, force, energy and difference from hard contact against time.

        Raises:
            MissingPackageError: matplotlib is not installed.
        """
        return draw(self.courses, Path(path))

    def __str__(self) -> str:
        return self.table()


def compare(
    source: Any,
    controller: ControlSource | None = None,
    *,
    seconds: float = 2.0,
    num_envs: int = 8,
    options: Options | None = None,
    start: tuple[Array, Array] | None = None,
    hold: float = 0.02,
    reward: Callable[..., Any] | None = None,
    seed: int = 0,
    progress: ProgressCallback | None = None,
) -> LawComparison:
    """Runs the same episodes with hard contact, with MuJoCo's contact law, and in MuJoCo if it is installed.

    Args:
        source: Source of the model, as for `stepper.load`. With a `Model` or a saved model, or if MuJoCo is not installed, the run in
            MuJoCo and the sliding distance are left out.
        controller: Controls (steps, nu) or (steps, num_envs, nu), in the actuators' units; after the end the last row is kept. Or a
            function of qpos (num_envs, nq) and qvel (num_envs, nv) that returns controls (num_envs, nu) or (nu,). None draws random
            controls.
        seconds: Length of an episode, s.
        num_envs: Number of episodes.
        options: Options of the step for both laws; `contact` is ignored. With MuJoCo's law, `integrator` is ignored too, and the integrator
            of the source is used.
        start: Initial positions (num_envs, nq), m and rad, and velocities (num_envs, nv), m/s and rad/s. None starts at the reference pose
            with small random velocities.
        hold: Time for which a random control is held, s.
        reward: Reward function with the arguments (qpos, qvel) before the step, controls (num_envs, nu), and (qpos, qvel) after it. It
            returns (num_envs,).
        seed: Seed of the random numbers.
        progress: Progress callback with the name of an engine and the fraction of its steps.

    Returns:
        The comparison: `print` shows its table, `LawComparison.draw` writes a picture.

    Raises:
        TypeError: An argument has another type.
        ValueError: A length is not positive, or `start` or `controller` has a wrong shape.
    """
    check_number("seconds", seconds, above=0.0)
    check_number("hold", hold, above=0.0)
    check_whole("num_envs", num_envs, least=1)
    check_whole("seed", seed, least=0)
    if options is not None:
        check_kind("options", options, Options, "write stepper.Options(...)")
    if callable(controller):
        check_takes(controller, ["qpos", "qvel"], "controller")
    if reward is not None and not callable(reward):
        raise TypeError(f"reward is {reward!r}, must be a function of (before, ctrl, after), or None")
    if reward is not None:
        check_takes(reward, ["before", "ctrl", "after"], "reward")
    model, compiled = _load(source)
    hard = replace(options or Options(), contact="hard")
    if hard.integrator in ("implicitfast", "discrete"):
        hard = replace(hard, integrator=None)
    law = replace(options or Options(), contact="mujoco", integrator=None)
    timestep = float(Stepper(model, options=hard).timestep)
    rng = np.random.default_rng(seed)
    if start is not None and (not isinstance(start, Sequence) or isinstance(start, str) or len(start) != 2):
        raise TypeError(f"start is {start!r}, must be two arrays, qpos and qvel, or None")
    qpos, qvel = _start(model, num_envs, rng) if start is None else (array_of("start", x) for x in start)
    if qpos.shape != (num_envs, model.nq) or qvel.shape != (num_envs, model.nv):
        raise ValueError(f"start has shapes {qpos.shape} and {qvel.shape}, must be ({num_envs}, {model.nq}) and ({num_envs}, {model.nv})")
    steps = max(1, round(seconds / timestep))
    if controller is None:
        controller = _random(model, num_envs, steps, max(1, round(hold / timestep)), rng)
    if not callable(controller):
        controller = array_of("controller", controller)
        shapes = ((num_envs, model.nu), (model.nu,))
        if controller.ndim not in (2, 3) or not len(controller) or controller.shape[1:] not in shapes:
            given = f"controller has shape {controller.shape}"
            raise ValueError(f"{given}, must be (steps, {model.nu}) or (steps, {num_envs}, {model.nu}), or a function of qpos and qvel")
    slip = Slip(compiled) if compiled is not None else None
    plans = {"hard": Plan(model, {}, hard), "MuJoCo's law": Plan(model, {}, law)}
    if compiled is not None:
        plans["MuJoCo"] = Plan(model, {}, Options(), mujoco={"timestep": timestep}, compiled=compiled)
    courses, report_progress = [], progress or silent
    for name, plan in plans.items():
        world = make_world(plan, num_envs)
        world.start(qpos, qvel, None, 0)
        courses.append(run(name, world, controller, steps, slip=slip, reward=reward, progress=report_progress))
    return LawComparison(tuple(courses), reward is not None)


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


def _start(model: Model, num_envs: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Reference pose as initial positions (num_envs, nq), and small random initial velocities (num_envs, nv), so that episodes differ."""
    qpos = np.tile(np.asarray(model.qpos0, float), (num_envs, 1))
    return qpos, rng.normal(0.0, 0.01, (num_envs, model.nv))


def _random(model: Model, num_envs: int, steps: int, hold: int, rng: np.random.Generator) -> Array:
    """Random controls within the actuators' ranges, (steps, num_envs, nu), each held for `hold` steps."""
    bounds = np.asarray(model.actuator_ctrlrange, float).reshape(model.nu, 2)
    low, high = np.where(np.isfinite(bounds), bounds, [-1.0, 1.0]).T
    drawn = rng.uniform(low, high, (steps // hold + 1, num_envs, model.nu))
    controls: Array = np.repeat(drawn, hold, axis=0)[:steps]
    return controls
