"""Step time of mjlab's Go1 on a ground, in stepper and in MuJoCo."""

import re
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from many_contacts.assets import Assets, written
from many_contacts.engines import LAW, Batch, Ours, Theirs
from many_contacts.measure import CHUNK, MEASURED_ENVS, chunk, restart
from many_contacts.scene import Array, Script
from many_contacts.scenes import unitree
from stepper import Model, ModelWarning, Status, load
from stepper._options import Precision
from stepper.lab.demo.race import MATCHED
from stepper.lab.demo.referee import Referee
from stepper.shared.machine import one_core

from terrains.grounds import Ground


@dataclass(frozen=True)
class Plan:
    """Extent of the measurement on a ground.

    Attributes:
        num_envs: Number of environments in stepper.
        peers: Number of environments in MuJoCo.
        steps: Number of steps in an episode.
        rounds: Number of repetitions of the episode, for the median time of each turn.
        noise: Standard deviation of the random actions, as a factor of that of mjlab's untrained policy. With 0 the robots stand still.
        precisions: Precisions of stepper, "f64" and "f32".
        law: Whether to measure stepper with MuJoCo's contact law too.
    """

    num_envs: int = 256
    peers: int = 64
    steps: int = 200
    rounds: int = 3
    noise: float = 1.0
    precisions: Sequence[Precision] = ("f64", "f32")
    law: bool = True


@dataclass
class Track:
    """Times and errors of an engine in an episode.

    Attributes:
        times: Microseconds per environment step, by turn and round.
        contacts: Number of touching pairs of geoms per environment, for each turn.
        penetration: Deepest penetration at the ends of the turns, m.
        flags: Number of environment steps with each status flag.
        env_steps: Number of environment steps whose flags are counted.
        iterations: Sum of the solver iterations over these steps.
    """

    times: dict[int, list[float]] = field(default_factory=dict)
    contacts: list[float] = field(default_factory=list)
    penetration: float = 0.0
    flags: Counter[str] = field(default_factory=Counter)
    env_steps: int = 0
    iterations: int = 0

    def add_step(self, batch: Ours) -> None:
        """Add the flags and iterations of the last step of a batch."""
        status = np.asarray(batch.sim.status)
        self.env_steps += status.size
        self.iterations += int(np.sum(batch.sim.iterations))
        for flag in Status:
            if count := int(np.count_nonzero(status & flag)):
                self.flags[str(flag.name)] += count

    def figures(self) -> dict[str, Any]:
        """Measured numbers by name, for JSON: time per environment step (us), contacts, penetration (m), flags and iterations per step.

        The time is the median over rounds for each turn, averaged over turns.
        """
        steps = max(self.env_steps, 1)
        return {
            "microseconds": float(np.mean([np.median(turn) for turn in self.times.values()])),
            "contacts": float(np.mean(self.contacts)),
            "penetration": self.penetration,
            "flags": {name: count / steps for name, count in self.flags.items()},
            "iterations": self.iterations / steps,
        }


def build(ground: Ground, cache: Path, out: Path) -> tuple[Model, Path]:
    """Model of stepper for a robot on a ground, and file of MuJoCo's model."""
    path = _written(ground, ground.add, cache, out)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        if ground.mesh is None:
            return load(path), path
        model = load(_written(ground, ground.mesh, cache, out / "meshes"))
    concave = model.geom_concave.copy()
    concave[list(model.geom_names).index("ground")] = 1
    return model.replace(geom_concave=concave), path


def _written(ground: Ground, add: Callable[[Any], None], cache: Path, out: Path) -> Path:
    """Write the MJCF file of the robot on a ground, and return the path of the file."""
    spec = unitree.spec(unitree.GO1, Assets(cache))
    spec.delete(spec.geom("floor"))
    add(spec)
    return written(spec, out / ("go1_" + re.sub(r"\W+", "_", ground.name) + ".xml"))


def script(ground: Ground, model: mujoco.MjModel, plan: Plan, seed: int = 0) -> Script:
    """Initial states and controls of an episode (a `Script`) on a ground.

    The robots start above the ground, and get the random actions of an untrained policy.
    """
    found = unitree.script(unitree.GO1, model, plan.num_envs, np.random.default_rng(seed), plan.noise)
    rng = np.random.default_rng(seed + 1)
    for qpos in (found.qpos, *(() if found.reset_qpos is None else found.reset_qpos)):
        qpos[:, :2] = rng.uniform(-ground.spread, ground.spread, (plan.num_envs, 2))
        qpos[:, 2] += _foothold(ground, qpos)
    return found


def _foothold(ground: Ground, qpos: Array) -> Array:
    """Largest height of the ground under each robot, m."""
    around = np.linspace(-0.35, 0.35, 15)
    dx, dy = (d.ravel() for d in np.meshgrid(around, around))
    return np.asarray(np.max(ground.height(qpos[:, :1] + dx, qpos[:, 1:2] + dy), axis=1))


def measure(ground: Ground, plan: Plan, cache: Path, out: Path) -> dict[str, Any]:
    """Measure the step times of all engines on a ground. Returns the name of the ground and the measured numbers, for JSON."""
    model, path = build(ground, cache, out)
    actions = script(ground, mujoco.MjModel.from_xml_path(str(path)), plan)
    referee = Referee(str(path))
    with one_core():
        batches: list[Batch] = [
            Ours(model, plan.num_envs, precision=precision, options=options, setting=setting)
            for precision in plan.precisions
            for setting, options in (("default", None), ("law", LAW))
            if setting == "default" or plan.law
        ]
        if plan.peers:
            peers = min(plan.peers, plan.num_envs)
            batches += [Theirs.from_file(str(path), peers, settings=MATCHED), Theirs.from_file(str(path), peers)]
        tracks = {batch.name: Track() for batch in batches}
        for k in range(plan.rounds):
            _play(batches, actions, plan, tracks, referee if k == 0 else None)
    return {"ground": ground.name, "engines": {name: track.figures() for name, track in tracks.items()}}


def _play(batches: Sequence[Batch], actions: Script, plan: Plan, tracks: dict[str, Track], referee: Referee | None) -> None:
    """Run an episode in all batches, which take turns of `CHUNK` steps."""
    for batch in batches:
        batch.begin(actions)
    restarts = {batch.name: np.zeros(batch.num_envs, np.intp) for batch in batches}
    for turn, begin in enumerate(range(0, plan.steps, CHUNK)):
        steps = range(begin, min(begin + CHUNK, plan.steps))
        for batch in batches:
            track = tracks[batch.name]
            counted = partial(track.add_step, batch) if referee is not None and isinstance(batch, Ours) else None
            track.times.setdefault(turn, []).append(chunk(batch, actions, steps, counted))
            if referee is not None:
                found = referee.measure(batch.qpos[:MEASURED_ENVS], batch.qvel[:MEASURED_ENVS])
                track.contacts.append(found.contacts)
                track.penetration = max(track.penetration, found.penetration)
            restart(batch, actions, restarts[batch.name])
