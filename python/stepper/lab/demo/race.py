"""Race of engines: the same environments in stepper and in MuJoCo, in turns, with random controls and then at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stepper.lab.engines import Array, EngineBatch, MujocoEngine, mujoco_model
from stepper.shared.machine import package_file, require
from stepper.shared.progress import ProgressCallback


@dataclass(frozen=True)
class Measured:
    """Measurements of the referee in some environments at one time.

    Attributes:
        contacts: Mean number of touching contact points per environment.
        penetration: Deepest overlap, m.
        kinetic_mean: Mean kinetic energy of an environment, J.
        kinetic_max: Largest kinetic energy of an environment, J.
    """

    contacts: float
    penetration: float
    kinetic_mean: float
    kinetic_max: float


class Referee:
    """Referee that measures states of all engines in the same way, with MuJoCo's collision detection and inertia matrix.

    Contact points count as touching if their distance is below `NEAR` plus the distance at which the model's contacts begin to exert
    forces. A body that rests a micrometre above the floor and one that sinks in therefore both touch it.
    """

    NEAR = 1e-4
    """Distance below which contact points count as touching, m, in addition to the model's own distance."""

    def __init__(self, path: str) -> None:
        self._mujoco = require("mujoco", "to measure both engines alike")
        self._model = mujoco_model(path)
        # Margin and gap grow by the same length: contacts are found farther away, and exert forces at the same distance as before.
        self._model.geom_margin[:] += 10 * self.NEAR
        self._model.geom_gap[:] += 10 * self.NEAR
        self._data = self._mujoco.MjData(self._model)

    def measure(self, qpos: Array, qvel: Array) -> Measured:
        """Measures contacts, penetration and energy of some states.

        Args:
            qpos: Positions, (n, nq), m and rad.
            qvel: Velocities, (n, nv), m/s and rad/s.

        Returns:
            Contacts, penetration and kinetic energy.
        """
        mujoco, model, data = self._mujoco, self._model, self._data
        contacts, deepest, kinetic = 0, 0.0, np.zeros(len(qpos))
        for env, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_collision(model, data)
            mujoco.mj_energyVel(model, data)
            distance = data.contact.dist
            contacts += int(np.count_nonzero(distance < data.contact.includemargin + self.NEAR))
            deepest = max(deepest, -float(np.min(distance, initial=0.0)))
            kinetic[env] = data.energy[1]
        return Measured(contacts / len(qpos), deepest, float(np.mean(kinetic)), float(np.max(kinetic)))


MATCHED = MujocoEngine(
    "implicitfast, elliptic",
    {"integrator": "implicitfast", "cone": "elliptic", "solver": "newton", "impratio": 1.0, "noslip_iterations": 0},
)
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
    """

    times: dict[str, list[float]] = field(default_factory=lambda: {"control": [], "rest": []})
    samples: dict[str, list[Measured]] = field(default_factory=lambda: {"control": [], "rest": []})


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


def _chunk(batch: EngineBatch, control: Array, plan: Plan, steps: range, clock: Callable[[], float]) -> float:
    """Makes some steps of the demo's plan with random controls, (k, num_envs, nu).

    The result is the duration in microseconds per step and environment.
    """
    quiet, spent = np.zeros((batch.num_envs, control.shape[2])), 0.0
    for step in steps:
        ctrl = control[step // plan.hold, : batch.num_envs] if step < plan.steps else quiet
        start = clock()
        batch.step(ctrl)
        spent += clock() - start
        batch.record("control" if step < plan.steps else "rest")
    return 1e6 * spent / (len(steps) * batch.num_envs)


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
                    measured = referee.measure(batch.qpos[: plan.num_peers], batch.qvel[: plan.num_peers])
                    tracks[batch.name].samples[phase].append(measured)
            order = order[1:] + order[:1]
            progress(what, steps.stop / (plan.steps + plan.rest))
    return tracks
