"""Measurement of a scene in stepper and MuJoCo, which take turns: times of each phase, unsolved steps, penetration and slip."""

import dataclasses
import hashlib
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import mujoco
import numpy as np
from comparison.throughput import fast
from stepper import Model, ModelError, ModelWarning, Options, load
from stepper._options import Precision
from stepper.lab.demo.race import MATCHED, Measured, Referee
from stepper.shared.machine import one_core

from many_contacts.engines import FINE, LAW, PGS, Batch, Ours, Theirs
from many_contacts.episodes import episode
from many_contacts.scene import Array, Phase, Scene, Script

CHUNK = 20
"""Number of steps in a turn of an engine. Between turns, states are measured and finished environments are reset."""
MEASURED_ENVS = 32
"""Number of environments of each batch whose contacts, penetration and slip are measured."""
LEAD = Options(tolerance=1e-3)
"""Options of stepper for the steps that lead to the initial states of an episode."""
DROPPED = 0.02
"""Displacement relative to the holder above which an object counts as dropped, m."""
SETTINGS = ("default", "fine", "fast", "pgs", "law")
"""Names of stepper's settings, see `options`."""


@dataclass(frozen=True)
class Plan:
    """Extent of the measurement.

    Attributes:
        num_envs: Number of environments in stepper.
        peers: Largest number of environments in MuJoCo; 0 omits MuJoCo. MuJoCo's time per environment step does not depend on their number.
        precisions: Precisions of stepper, "f64" and "f32".
        settings: Settings of stepper, a subset of `SETTINGS`.
        rounds: Number of repetitions from the same states, for the median time of each chunk.
        patience: Time after which no new round starts, s. The first round is always run.
        seed: Seed of all random numbers.
    """

    num_envs: int = 64
    peers: int = 64
    precisions: tuple[Precision, ...] = ("f64", "f32")
    settings: tuple[str, ...] = ("default",)
    rounds: int = 5
    patience: float = 120.0
    seed: int = 0


@dataclass
class Track:
    """Measurements of one batch of environments in a phase of the episode.

    Attributes:
        times: Times per environment step, us: a list for each chunk, with a time for each round.
        steps: Number of steps of each chunk.
        samples: Contacts and penetration at the end of each chunk.
        before: Initial position of the held object in the frame of its holder, (environments, 3), m.
        after: Final position of the held object in that frame, (environments, 3), m.
    """

    times: list[list[float]] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    samples: list[Measured] = field(default_factory=list)
    before: Array | None = None
    after: Array | None = None

    @property
    def microseconds(self) -> float:
        """Time per environment step, us: median over rounds for each chunk, averaged over chunks by their length."""
        return sum(median(found) * steps for found, steps in zip(self.times, self.steps, strict=True)) / sum(self.steps)

    @property
    def slip(self) -> tuple[float, float] | None:
        """Median displacement of the held objects relative to their holder, m, and fraction of the objects that were dropped."""
        if self.before is None or self.after is None:
            return None
        way = np.linalg.norm(self.after - self.before, axis=1)
        return float(np.median(way)), float(np.mean(way > DROPPED))


def options(setting: str, model: Model) -> Options | None:
    """Options of stepper for a setting, "default", "fine", "fast", "pgs" or "law", and a model. None means the default options."""
    return {"default": None, "fine": FINE, "fast": fast(model), "pgs": PGS, "law": LAW}[setting]


def read(path: Path) -> tuple[Model, str]:
    """Load an MJCF file in stepper. Returns the model, and a note about omitted elements, empty if the model is complete."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        try:
            return load(path), ""
        except ModelError as error:
            return load(path, strict=False), f"not strict: {' '.join(str(error).split())[:200]}"


def measure(scene: Scene, path: Path, plan: Plan, model: Model | None = None) -> list[dict[str, Any]]:
    """Measure a scene in stepper and MuJoCo.

    Args:
        scene: Scene.
        path: MJCF file of the scene.
        plan: Extent of the measurement.
        model: Model of stepper. None loads the file.

    Raises:
        stepper.ModelError: stepper cannot load the model.
    """
    model, note = read(path) if model is None else (model, "")
    compiled = mujoco.MjModel.from_xml_path(str(path))
    script = _script(scene, path, model, plan.num_envs, plan.seed)
    peers = min(plan.num_envs, plan.peers)
    with one_core():
        ours = {
            (precision, setting): Ours(model, plan.num_envs, precision=precision, options=options(setting, model), setting=setting)
            for precision in plan.precisions
            for setting in plan.settings
        }
        theirs = [Theirs.from_file(str(path), peers, settings=settings) for settings in (MATCHED, None) if peers]
        batches: list[Batch] = [*ours.values(), *theirs]
        tracks = _play(scene, script, batches, plan, _StateMeter(compiled, path))
    rows = []
    for phase in scene.phases:
        if not phase.timed:
            continue
        row = {
            "scene": scene.name,
            "group": scene.group or scene.name,
            "row": scene.row(phase),
            "num_envs": plan.num_envs,
            "nv": compiled.nv,
            "timestep": compiled.opt.timestep,
            "steps": phase.steps,
            "rounds": len(tracks[batches[0].name, phase.name].times[0]),
            "note": note,
            "ours": {},
            "theirs": {b.name: _figures(tracks[b.name, phase.name]) | {"failed": b.failed, "environments": peers} for b in theirs},
        }
        best = min((found["microseconds"] for found in row["theirs"].values()), default=float("nan"))
        for (precision, setting), batch in ours.items():
            effort = batch.efforts[phase.name]
            figures = _figures(tracks[batch.name, phase.name])
            row["ours"][f"{precision} {setting}"] = figures | {
                "ratio": best / figures["microseconds"],
                "unsolved": effort.not_converged / effort.env_steps,
                "sweeps": (effort.sweeps - effort.newton_steps) / effort.env_steps,
                "newton_steps": effort.newton_steps / effort.env_steps,
                "worst_residual": effort.worst_residual,
                "contacts_full": effort.contacts_full,
                "non_finite": effort.non_finite,
                "flags": {name: count / effort.env_steps for name, count in effort.flags.items() if count},
            }
        rows.append(row)
    return rows


def save_episodes(scene: Scene, path: Path, plan: Plan, folder: Path) -> None:
    """Run a scene once in stepper with default options, and record each timed phase as an episode for the program `anatomy`.

    Raises:
        stepper.ModelError: stepper cannot load the model.
    """
    model, _ = read(path)
    script = _script(scene, path, model, plan.num_envs, plan.seed)
    for precision in plan.precisions:
        batch = Ours(model, plan.num_envs, precision=precision, options=None, setting="default")
        restarts = np.zeros(plan.num_envs, np.intp)
        batch.begin(script)
        for phase, chunks in _chunks(scene):
            with episode(batch.sim, folder, scene.row(phase)) if phase.timed else nullcontext():
                for steps in chunks:
                    chunk(batch, script, steps)
                    restart(batch, script, restarts)


def player(scene: Scene, path: Path, num_envs: int, precision: Precision) -> Callable[[], dict[str, float]]:
    """Function that plays a scene's episode in stepper with default options. It returns the time of each phase, us per environment step."""
    model, _ = read(path)
    script = _script(scene, path, model, num_envs, seed=0)
    batch = Ours(model, num_envs, precision=precision, options=None, setting="default")

    def play() -> dict[str, float]:
        batch.begin(script)
        times, restarts = {}, np.zeros(num_envs, np.intp)
        for phase, chunks in _chunks(scene):
            total = 0.0
            for steps in chunks:
                total += chunk(batch, script, steps) * len(steps)
                restart(batch, script, restarts)
            if phase.timed:
                times[scene.row(phase)] = total / phase.steps
        return times

    return play


def _chunks(scene: Scene) -> Iterator[tuple[Phase, list[range]]]:
    """Phases of a scene, with the steps of each turn of an engine."""
    first = 0
    for phase in scene.phases:
        end = first + phase.steps
        yield phase, [range(begin, min(begin + CHUNK, end)) for begin in range(first, end, CHUNK)]
        first = end


def _script(scene: Scene, path: Path, model: Model, num_envs: int, seed: int) -> Script:
    """Script of a scene whose initial states are those after the first `scene.lead` steps, in which objects fall and settle.

    stepper makes these steps in f64, for all engines. A file next to the model's file `path` caches the states.
    """
    script = scene.script(mujoco.MjModel.from_xml_path(str(path)), num_envs, np.random.default_rng(seed))
    if not scene.lead:
        return script
    digest = hashlib.sha256(path.read_bytes() + repr(LEAD).encode())
    for part in (script.qpos, script.qvel, script.control[0], script.push):
        digest.update(np.array(0.0 if part is None else part).tobytes())
    kept = path.with_name(f"{path.stem}-{len(script.qpos)}-{scene.lead}-{digest.hexdigest()[:12]}.npz")
    if not kept.exists():
        batch = Ours(model, len(script.qpos), precision="f64", options=LEAD, setting="lead")
        batch.begin(script)
        batch.sim.step(script.control[0], nstep=scene.lead)
        np.savez(kept, qpos=batch.qpos, qvel=batch.qvel)
    with np.load(kept) as state:
        return dataclasses.replace(script, qpos=state["qpos"], qvel=state["qvel"])


def _figures(track: Track) -> dict[str, Any]:
    """Results of one batch in one phase, as numbers by name for JSON: time, contacts, penetration and slip."""
    return {
        "microseconds": track.microseconds,
        "contacts": float(np.mean([s.contacts for s in track.samples])),
        "penetration": max(s.penetration for s in track.samples),
        "slip": track.slip,
    }


class _StateMeter:
    """Measurement of states of both engines with MuJoCo's collision detection and kinematics.

    Args:
        model: Compiled model of the scene.
        path: MJCF file of the scene.
    """

    def __init__(self, model: mujoco.MjModel, path: Path) -> None:
        self.model, self.data, self.referee = model, mujoco.MjData(model), Referee(str(path))

    def measure(self, batch: Batch) -> Measured:
        """Contacts and penetration of the first `MEASURED_ENVS` environments."""
        return self.referee.measure(batch.qpos[:MEASURED_ENVS], batch.qvel[:MEASURED_ENVS])

    def places(self, batch: Batch, held: tuple[str, str]) -> Array:
        """Positions of a held body in the frame of the holding body, in the first `MEASURED_ENVS` environments: (environments, 3), m."""
        body, holder = (self.model.body(name).id for name in held)
        out = []
        for qpos in batch.qpos[:MEASURED_ENVS]:
            self.data.qpos[:] = qpos
            mujoco.mj_kinematics(self.model, self.data)
            out.append(self.data.xmat[holder].reshape(3, 3).T @ (self.data.xpos[body] - self.data.xpos[holder]))
        return np.array(out)


def _play(scene: Scene, script: Script, batches: Sequence[Batch], plan: Plan, meter: _StateMeter) -> dict[tuple[str, str], Track]:
    """Simulate the episode of a script `plan.rounds` times in all batches, which take turns of `CHUNK` steps."""
    tracks = {(batch.name, phase.name): Track() for batch in batches for phase in scene.phases}
    order, start = list(batches), time.perf_counter()
    for k in range(plan.rounds):
        if k and (time.perf_counter() - start) * (k + 1) / k > plan.patience:
            break
        restarts = {batch.name: np.zeros(batch.num_envs, np.intp) for batch in batches}
        for batch in batches:
            batch.begin(script)
        for phase, chunks in _chunks(scene):
            for turn, steps in enumerate(chunks):
                for batch in order:
                    track = tracks[batch.name, phase.name]
                    if k == 0 and phase.held and turn == 0:
                        track.before = meter.places(batch, phase.held)
                    spent = chunk(batch, script, steps, partial(batch.record, phase.name) if k == 0 else None)
                    if k == 0:
                        track.times.append([])
                        track.steps.append(len(steps))
                        track.samples.append(meter.measure(batch))
                    track.times[turn].append(spent)
                    restart(batch, script, restarts[batch.name])
                order = order[1:] + order[:1]
            if k == 0 and phase.held:
                for batch in batches:
                    tracks[batch.name, phase.name].after = meter.places(batch, phase.held)
    return tracks


def chunk(batch: Batch, script: Script, steps: range, after: Callable[[], None] | None = None) -> float:
    """Step a batch through a part of an episode, and call `after` after each step. Returns the processor time per environment step, us."""
    spent, n = 0.0, batch.num_envs
    for step in steps:
        block = min(step // script.hold, len(script.control) - 1)
        if script.mocap is not None:
            batch.move(script.mocap[min(step // script.hold, len(script.mocap) - 1), :n])
        ctrl = script.control[block, :n]
        start = time.process_time()
        batch.step(ctrl)
        spent += time.process_time() - start
        if after is not None:
            after()
    return 1e6 * spent / (len(steps) * n)


def restart(batch: Batch, script: Script, restarts: Any) -> None:
    """Reset the environments whose episode has ended to the next configurations of `Script.reset_qpos`, and count the resets of each."""
    if script.ended is None or script.reset_qpos is None:
        return
    mask = script.ended(batch.qpos)
    if mask.any():
        envs = np.arange(batch.num_envs)
        batch.restart(mask, script.reset_qpos[restarts % len(script.reset_qpos), envs])
        restarts += mask
