"""The main job: a thousand humanoids fall about and lie still, beside MuJoCo, speed and error in one table."""

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
from stepper.lab.engine_chart import SCENES, Effort, charts
from stepper.lab.engines import Array, Crowd, MujocoCrowd, MujocoEngine, StepperCrowd
from stepper.lab.progress import Tick, progress, show_files
from stepper.loading import load
from stepper.shared.machine import allowed_cores, one_core, package_file, provenance, require

MATCHED = MujocoEngine("implicitfast, elliptic", "IMPLICITFAST", "ELLIPTIC", "NEWTON")


@dataclass(frozen=True)
class Plan:
    """What the demo does.

    Attributes:
        num_envs: Humanoids in stepper.
        steps: Steps of random control.
        rest: Steps without control after that.
        seed: Of the random control.
        peers: Humanoids in MuJoCo, which is slower; they get the controls of the first ones. None is a quarter.
        hold: Steps that a random control is held.
        chunk: Steps of one engine before it is the next one's turn. Everything is measured at the end of a chunk.
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
        """Humanoids in MuJoCo."""
        wanted = max(1, self.num_envs // 4) if self.peers is None else self.peers
        return min(self.num_envs, wanted)


@dataclass
class Track:
    """One engine's way through the plan.

    Attributes:
        times: Microseconds per step and environment of every chunk, by phase ("control", "rest").
        samples: What the referee found at the end of every chunk, by phase.
        own: (contacts per environment, deepest overlap in m) as stepper's own contacts have it, by phase.
        after_control: qpos (num_envs, nq) when the control ended.
    """

    times: dict[str, list[float]] = field(default_factory=lambda: {"control": [], "rest": []})
    samples: dict[str, list[Measured]] = field(default_factory=lambda: {"control": [], "rest": []})
    own: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: {"control": [], "rest": []})
    after_control: Array | None = None


def humanoid_path() -> str:
    """The MJCF file of dm_control's humanoid.

    Raises:
        MissingPackageError: dm_control is not installed.
    """
    return package_file("dm_control", "suite/humanoid.xml", "for its humanoid")


def random_control(path: str, plan: Plan) -> Array:
    """Random controls, each held for `plan.hold` steps; the same array serves every engine.

    Args:
        path: The MJCF file, for the actuators' ranges.
        plan: Number of steps, how long each control is held, the seed.

    Returns:
        Uniform in the actuators' ranges, in -1 to 1 where there is none, (ceil(steps / hold), num_envs, nu).
    """
    mujoco = require("mujoco", "to read the model")
    model = mujoco.MjModel.from_xml_path(path)
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, (-1.0, 1.0)).T
    return np.random.default_rng(plan.seed).uniform(low, high, (-(-plan.steps // plan.hold), plan.num_envs, model.nu))


def _own_contacts(crowd: StepperCrowd, sample: int = 32) -> tuple[float, float]:
    found = [crowd.sim.contacts(env)["distance"] for env in range(min(sample, crowd.num_envs))]
    deepest = max(-float(np.min(distance, initial=0.0)) for distance in found)
    return sum(map(len, found)) / len(found), deepest


def _chunk(crowd: Crowd, control: Array, plan: Plan, steps: range, clock: Callable[[], float]) -> float:
    """Makes some steps of the plan; returns microseconds per step and environment."""
    quiet, spent = np.zeros((crowd.num_envs, control.shape[2])), 0.0
    for step in steps:
        ctrl = control[step // plan.hold, : crowd.num_envs] if step < plan.steps else quiet
        start = clock()
        crowd.step(ctrl)
        spent += clock() - start
        crowd.record("control" if step < plan.steps else "rest")
    return 1e6 * spent / (len(steps) * crowd.num_envs)


def _look(crowd: Crowd, track: Track, phase: str, referee: Referee, plan: Plan) -> None:
    track.samples[phase].append(referee.measure(crowd.qpos[: plan.num_peers], crowd.qvel[: plan.num_peers]))
    if isinstance(crowd, StepperCrowd):
        track.own[phase].append(_own_contacts(crowd))


def race(
    crowds: Sequence[Crowd], control: Array, plan: Plan, *, clock: Callable[[], float], tick: Tick, what: str, referee: Referee | None
) -> dict[str, Track]:
    """Steps all crowds through the plan, in turns of a chunk each, so that what else the machine does falls on all alike.

    Args:
        crowds: Who runs.
        control: From `random_control`.
        plan: The plan.
        clock: Seconds: processor time on one core, wall time on many.
        tick: Progress.
        what: Its text.
        referee: Who measures at the end of every chunk; None leaves that out.

    Returns:
        By name, the way of each.
    """
    tracks = {crowd.name: Track() for crowd in crowds}
    phases = [("control", 0, plan.steps), ("rest", plan.steps, plan.steps + plan.rest)]
    order = list(crowds)
    for phase, first, last in phases:
        for begin in range(first, last, plan.chunk):
            steps = range(begin, min(begin + plan.chunk, last))
            for crowd in order:
                tracks[crowd.name].times[phase].append(_chunk(crowd, control, plan, steps, clock))
                if referee:
                    _look(crowd, tracks[crowd.name], phase, referee, plan)
            order = order[1:] + order[:1]
            tick(what, steps.stop / (plan.steps + plan.rest))
        if phase == "control":
            for crowd in crowds:
                tracks[crowd.name].after_control = crowd.qpos
    return tracks


def _crowds(model: Model, path: str, plan: Plan, threads: int) -> list[Crowd]:
    return [
        StepperCrowd(model, plan.num_envs, threads=threads),
        StepperCrowd(model, plan.num_envs, precision="f32", threads=threads),
        MujocoCrowd.from_file(path, plan.num_peers, threads=threads, settings=MATCHED),
        MujocoCrowd.from_file(path, plan.num_peers, threads=threads),
    ]


def _ratios(ours: Track, theirs: Track) -> dict[str, float]:
    """How many times faster, by phase: the median of the ratios of chunks that ran one after the other."""
    pairs = {phase: list(zip(times, theirs.times[phase], strict=True)) for phase, times in ours.times.items() if times}
    return {phase: median(their / our for our, their in both) for phase, both in pairs.items()}


def _engine_figures(crowd: Crowd, one: Track, many: Track, peers: dict[str, Track]) -> dict[str, object]:
    """Figures of one engine; rates are medians over the chunks."""
    rates = {phase: 1e6 / median(times) for phase, times in one.times.items() if times}
    spread = {phase: [1e6 / max(times), 1e6 / min(times)] for phase, times in one.times.items() if times}
    samples = one.samples["control"] + one.samples["rest"]
    figures: dict[str, object] = {
        "num_envs": crowd.num_envs,
        "steps_per_second_one_core": rates,
        "steps_per_second_one_core_slowest_fastest_chunk": spread,
        "ratio_one_core": {name: _ratios(one, theirs) for name, theirs in peers.items()},
        "steps_per_second_all_cores": {"control": 1e6 / median(many.times["control"])},
        "worst_penetration": max(s.penetration for s in samples),
        "contacts_mean": {phase: float(np.mean([s.contacts for s in found])) for phase, found in one.samples.items() if found},
        "at_the_end": dataclasses.asdict(samples[-1]),
    }
    if isinstance(crowd, StepperCrowd):
        own = one.own["control"] + one.own["rest"]
        figures["certificates"] = {phase: dataclasses.asdict(certificate) for phase, certificate in crowd.certificates.items()}
        figures["own_contacts"] = {"mean": float(np.mean([c for c, _ in own])), "worst_penetration": max(d for _, d in own)}
        same = one.after_control is not None and many.after_control is not None and np.array_equal(one.after_control, many.after_control)
        figures["same_bits_on_one_and_all_cores"] = bool(same)
        figures["timestep"] = crowd.sim.timestep
        figures["options"] = dataclasses.asdict(crowd.sim.options)
    return figures


def measure(plan: Plan, tick: Tick) -> dict[str, object]:
    """Runs the plan on one core and its controlled part on all cores.

    Args:
        plan: What to do.
        tick: Progress.

    Returns:
        All figures and settings, ready for JSON.
    """
    path = humanoid_path()
    model, control, referee = load(path), random_control(path, plan), Referee(path)
    with one_core() as core:
        crowds = _crowds(model, path, plan, threads=1)
        one = race(crowds, control, plan, clock=time.process_time, tick=tick, what="one core", referee=referee)
    short = dataclasses.replace(plan, rest=0, peers=plan.num_peers)
    others = _crowds(model, path, short, threads=0)
    many = race(others, control, short, clock=time.perf_counter, tick=tick, what="all cores", referee=None)
    peers = {crowd.name: one[crowd.name] for crowd in crowds if isinstance(crowd, MujocoCrowd)}
    figures = {crowd.name: _engine_figures(crowd, one[crowd.name], many[crowd.name], peers) for crowd in crowds}
    return {
        "model": "dm_control/suite/humanoid.xml",
        "plan": dataclasses.asdict(plan) | {"peers": plan.num_peers},
        "core": core,
        "num_cores": len(allowed_cores()),
        "engines": figures,
        "provenance": provenance(),
    }


def demo(plan: Plan, out: Path) -> dict[str, object]:
    """Runs, shows progress, prints the table, writes `demo.json` and the charts.

    Args:
        plan: What to do.
        out: The folder, made if it is not there.

    Returns:
        What `measure` returned.
    """
    require("rich", "for the demo's table")
    out.mkdir(parents=True, exist_ok=True)
    with progress() as tick:
        figures = measure(plan, tick)
        pictures = charts(list(SCENES), out, Effort.quick(), tick)
    (out / "demo.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    show(figures)
    show_files([out / "demo.json", *pictures])
    return figures
