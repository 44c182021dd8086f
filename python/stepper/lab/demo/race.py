"""Race of the demo: a thousand humanoids fall and come to rest in stepper and in MuJoCo, with speed and errors in one table."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

from stepper._stepper import Model
from stepper.lab.demo.referee import Measured, Referee
from stepper.lab.demo.report import show
from stepper.lab.engines import Array, EngineBatch, MujocoBatch, MujocoEngine, StepperBatch, mujoco_model
from stepper.loading import load
from stepper.shared.files import locked, write_text
from stepper.shared.machine import allowed_cores, one_core, package_file, provenance, require
from stepper.shared.progress import ProgressCallback, show_files, show_progress

MATCHED = MujocoEngine("implicitfast, elliptic", "IMPLICITFAST", "ELLIPTIC", "NEWTON")
"""Settings of MuJoCo that are most similar to stepper's default settings."""


@dataclass(frozen=True)
class Plan:
    """Settings of the demo.

    Attributes:
        num_envs: Number of humanoids in stepper.
        steps: Number of steps with random controls.
        rest: Number of further steps, with all controls 0.
        seed: Seed of the random controls.
        peers: Number of humanoids in MuJoCo. They get the controls of the first humanoids in stepper. None selects a quarter of `num_envs`,
            because MuJoCo is slower.
        hold: Number of steps for which a random control is held.
        chunk: Number of steps of one engine before the next engine's turn. States are measured at the end of a chunk.
    """

    num_envs: int = 1024
    steps: int = 500
    rest: int = 1000
    seed: int = 0
    peers: int | None = None
    hold: int = 5
    chunk: int = 25

    def __post_init__(self) -> None:
        for name, least in (("num_envs", 1), ("steps", 1), ("rest", 0), ("hold", 1), ("chunk", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, must be at least {least}")

    @property
    def num_peers(self) -> int:
        """Number of humanoids in MuJoCo."""
        peers = max(1, self.num_envs // 4) if self.peers is None else self.peers
        return min(self.num_envs, peers)


@dataclass
class Track:
    """Measurements of one engine in the race.

    Attributes:
        times: Microseconds per step and environment of every chunk, by phase ("control", "rest").
        samples: Measurements of the referee at the end of every chunk, by phase.
        own: Contacts per environment and deepest overlap (m) at the end of every chunk, according to stepper's contacts, by phase.
        after_control: Positions after the last step with random controls, (num_envs, nq), m and rad.
    """

    times: dict[str, list[float]] = field(default_factory=lambda: {"control": [], "rest": []})
    samples: dict[str, list[Measured]] = field(default_factory=lambda: {"control": [], "rest": []})
    own: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: {"control": [], "rest": []})
    after_control: Array | None = None


def humanoid_path() -> str:
    """Path of the MJCF file of dm_control's humanoid.

    Raises:
        MissingPackageError: dm_control is not installed.
    """
    return package_file("dm_control", "suite/humanoid.xml", "for its humanoid")


def random_control(path: str, plan: Plan) -> Array:
    """Random controls, each held for `plan.hold` steps; the same array serves every engine.

    Returns:
        Controls, (k, num_envs, nu) with k = ceil(steps / hold), uniform in the actuators' ranges; without a range, from
        -1 to 1.
    """
    model = mujoco_model(path)
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, (-1.0, 1.0)).T
    return np.random.default_rng(plan.seed).uniform(low, high, (-(-plan.steps // plan.hold), plan.num_envs, model.nu))


def _own_contacts(batch: StepperBatch, sample: int = 32) -> tuple[float, float]:
    """Mean number of contacts per environment and deepest overlap (m) in the first `sample` environments, from stepper's contacts."""
    found = [batch.sim.contacts(env)["distance"] for env in range(min(sample, batch.num_envs))]
    deepest = max(-float(np.min(distance, initial=0.0)) for distance in found)
    return sum(map(len, found)) / len(found), deepest


def _chunk(batch: EngineBatch, control: Array, plan: Plan, steps: range, clock: Callable[[], float]) -> float:
    """Makes some steps of the demo's plan, and returns the duration in microseconds per step and environment.

    Args:
        batch: Environments of one engine.
        control: Random controls, (k, num_envs, nu).
        plan: Settings of the demo.
        steps: Indices of the steps to make.
        clock: Clock, s.
    """
    quiet, spent = np.zeros((batch.num_envs, control.shape[2])), 0.0
    for step in steps:
        ctrl = control[step // plan.hold, : batch.num_envs] if step < plan.steps else quiet
        start = clock()
        batch.step(ctrl)
        spent += clock() - start
        batch.record("control" if step < plan.steps else "rest")
    return 1e6 * spent / (len(steps) * batch.num_envs)


def _add_measurements(batch: EngineBatch, track: Track, phase: str, referee: Referee, plan: Plan) -> None:
    """Adds measurements of the present states of an engine to its track."""
    track.samples[phase].append(referee.measure(batch.qpos[: plan.num_peers], batch.qvel[: plan.num_peers]))
    if isinstance(batch, StepperBatch):
        track.own[phase].append(_own_contacts(batch))


def race(
    batches: Sequence[EngineBatch],
    control: Array,
    plan: Plan,
    *,
    clock: Callable[[], float],
    progress: ProgressCallback,
    what: str,
    referee: Referee | None,
) -> dict[str, Track]:
    """Time all engines on the steps of the plan, with random controls first and zero controls after them.

    The engines take turns of `plan.chunk` steps, so that other load of the machine affects all of them equally.

    Args:
        batches: Batches of the engines.
        control: Random controls, (k, num_envs, nu), in the actuators' units; each of the k is held for `plan.hold` steps.
        plan: Settings of the race.
        clock: Clock, s: processor time on one core, wall time on many.
        progress: Progress callback.
        what: Text for the progress callback.
        referee: Measurement of contacts and penetration by MuJoCo, for all engines, after every chunk; None does not measure.

    Returns:
        Times and measurements of each engine, by its name.
    """
    tracks = {batch.name: Track() for batch in batches}
    phases = [("control", 0, plan.steps), ("rest", plan.steps, plan.steps + plan.rest)]
    order = list(batches)
    for phase, first, last in phases:
        for begin in range(first, last, plan.chunk):
            steps = range(begin, min(begin + plan.chunk, last))
            for batch in order:
                tracks[batch.name].times[phase].append(_chunk(batch, control, plan, steps, clock))
                if referee:
                    _add_measurements(batch, tracks[batch.name], phase, referee, plan)
            order = order[1:] + order[:1]
            progress(what, steps.stop / (plan.steps + plan.rest))
        if phase == "control":
            for batch in batches:
                tracks[batch.name].after_control = batch.qpos
    return tracks


def _batches(model: Model, path: str, plan: Plan, threads: int) -> list[EngineBatch]:
    """Batches of all engines: stepper in f64 and f32, and MuJoCo with matched and with default settings."""
    return [
        StepperBatch(model, plan.num_envs, threads=threads),
        StepperBatch(model, plan.num_envs, precision="f32", threads=threads),
        MujocoBatch.from_file(path, plan.num_peers, threads=threads, settings=MATCHED),
        MujocoBatch.from_file(path, plan.num_peers, threads=threads),
    ]


def _ratios(ours: Track, theirs: Track) -> dict[str, float]:
    """Speed of the first engine divided by the speed of the second, by phase of the race ("control", "rest").

    This ratio is the median, over chunks of steps, of the ratios of the two engines' times for the chunk.
    """
    pairs = {phase: list(zip(times, theirs.times[phase], strict=True)) for phase, times in ours.times.items() if times}
    return {phase: median(their / our for our, their in both) for phase, both in pairs.items()}


def _engine_figures(batch: EngineBatch, one: Track, many: Track, peers: dict[str, Track]) -> dict[str, object]:
    """Results of one engine for the demo's table, by name: speeds (medians over chunks of steps), contacts, penetration and energy."""
    rates = {phase: 1e6 / median(times) for phase, times in one.times.items() if times}
    spread = {phase: [1e6 / max(times), 1e6 / min(times)] for phase, times in one.times.items() if times}
    samples = one.samples["control"] + one.samples["rest"]
    figures: dict[str, object] = {
        "num_envs": batch.num_envs,
        "steps_per_second_one_core": rates,
        "steps_per_second_one_core_slowest_fastest_chunk": spread,
        "ratio_one_core": {name: _ratios(one, theirs) for name, theirs in peers.items()},
        "steps_per_second_all_cores": {"control": 1e6 / median(many.times["control"])},
        "worst_penetration": max(s.penetration for s in samples),
        "contacts_mean": {phase: float(np.mean([s.contacts for s in found])) for phase, found in one.samples.items() if found},
        "at_the_end": dataclasses.asdict(samples[-1]),
    }
    if isinstance(batch, StepperBatch):
        own = one.own["control"] + one.own["rest"]
        figures["solver_statistics"] = {phase: dataclasses.asdict(statistics) for phase, statistics in batch.solver_statistics.items()}
        figures["own_contacts"] = {"mean": float(np.mean([c for c, _ in own])), "worst_penetration": max(d for _, d in own)}
        same = one.after_control is not None and many.after_control is not None and np.array_equal(one.after_control, many.after_control)
        figures["same_bits_on_one_and_all_cores"] = bool(same)
        figures["timestep"] = batch.sim.timestep
        figures["options"] = dataclasses.asdict(batch.sim.options) | {"tolerance": batch.sim.tolerance}
    return figures


def measure(plan: Plan, progress: ProgressCallback) -> dict[str, object]:
    """Runs the whole plan on one core, and only its first phase, the fall with random controls, on all cores.

    Returns:
        Results of all engines, and settings, as values that JSON can represent.
    """
    path = humanoid_path()
    model, control, referee = load(path), random_control(path, plan), Referee(path)
    with one_core() as core:
        batches = _batches(model, path, plan, threads=1)
        one = race(batches, control, plan, clock=time.process_time, progress=progress, what="one core", referee=referee)
    short = dataclasses.replace(plan, rest=0, peers=plan.num_peers)
    others = _batches(model, path, short, threads=0)
    many = race(others, control, short, clock=time.perf_counter, progress=progress, what="all cores", referee=None)
    peers = {batch.name: one[batch.name] for batch in batches if isinstance(batch, MujocoBatch)}
    figures = {batch.name: _engine_figures(batch, one[batch.name], many[batch.name], peers) for batch in batches}
    return {
        "model": "dm_control/suite/humanoid.xml",
        "plan": dataclasses.asdict(plan) | {"peers": plan.num_peers},
        "core": core,
        "num_cores": len(allowed_cores()),
        "engines": figures,
        "provenance": provenance(),
    }


def demo(plan: Plan, out: Path) -> dict[str, object]:
    """Runs the demo: prints the table, and writes `demo.json`.

    Returns:
        Results and settings, as returned by `measure`.
    """
    require("rich", "for the demo's table")
    with locked(out):
        with show_progress() as progress:
            figures = measure(plan, progress)
        file = write_text(out / "demo.json", json.dumps(figures, indent=2) + "\n")
    show(figures)
    show_files([file])
    return figures
