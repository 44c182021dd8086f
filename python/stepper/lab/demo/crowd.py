"""Many environments of one model, in stepper and in MuJoCo, behind one face; and a referee who measures both alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options, Precision
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.lab.engine_chart.engines import MujocoEngine
from stepper.shared.machine import require

Array = NDArray[np.float64]


class Crowd(Protocol):
    """Environments that are stepped together."""

    @property
    def name(self) -> str:
        """Engine and settings."""

    @property
    def num_envs(self) -> int:
        """Number of environments."""

    @property
    def qpos(self) -> Array:
        """Configuration, (num_envs, nq)."""

    @property
    def qvel(self) -> Array:
        """Velocity, (num_envs, nv)."""

    def step(self, ctrl: Array) -> None:
        """Makes one step with controls (num_envs, nu). This is the call that is timed."""

    def record(self, phase: str) -> None:
        """Notes what the engine says of its last step, a step of `phase`. Not timed."""


@dataclass
class Certificate:
    """What stepper said of its steps, over a phase of a run.

    Attributes:
        env_steps: Steps times environments.
        worst_residual: Largest natural-map residual, m/s.
        not_converged: Environment-steps with NOT_CONVERGED.
        non_finite: Environment-steps with NON_FINITE.
        contacts_full: Environment-steps with CONTACTS_FULL.
        sweeps: Sum of the solver's sweeps and Newton steps.
    """

    env_steps: int = 0
    worst_residual: float = 0.0
    not_converged: int = 0
    non_finite: int = 0
    contacts_full: int = 0
    sweeps: int = 0

    def add(self, sim: Stepper) -> None:
        """Adds the last step of a batch."""
        status = np.asarray(sim.status)
        self.env_steps += status.size
        self.worst_residual = max(self.worst_residual, float(np.max(sim.residual)))
        self.not_converged += int(np.count_nonzero(status & Status.NOT_CONVERGED))
        self.non_finite += int(np.count_nonzero(status & Status.NON_FINITE))
        self.contacts_full += int(np.count_nonzero(status & Status.CONTACTS_FULL))
        self.sweeps += int(np.sum(sim.iterations))


class StepperCrowd:
    """Ours.

    Args:
        model: What to step.
        num_envs: Number of environments.
        precision: "f64" or "f32".
        threads: Threads; 0 is one per core.
        options: Settings; None is the default.
        setting: Their name in tables.
    """

    def __init__(
        self,
        model: Model,
        num_envs: int,
        *,
        precision: Precision = "f64",
        threads: int = 1,
        options: Options | None = None,
        setting: str = "",
    ) -> None:
        self.sim = Stepper(model, num_envs, options=options, precision=precision, threads=threads)
        self.name = f"stepper {precision} {setting}".strip()
        self.num_envs = num_envs
        self.certificates: dict[str, Certificate] = {}

    @property
    def qpos(self) -> Array:
        """See `Crowd.qpos`."""
        return np.asarray(self.sim.qpos, dtype=np.float64)

    @property
    def qvel(self) -> Array:
        """See `Crowd.qvel`."""
        return np.asarray(self.sim.qvel, dtype=np.float64)

    def step(self, ctrl: Array) -> None:
        """See `Crowd.step`."""
        self.sim.step(ctrl)

    def record(self, phase: str) -> None:
        """See `Crowd.record`."""
        self.certificates.setdefault(phase, Certificate()).add(self.sim)


def mujoco_model(path: str, settings: MujocoEngine | None = None) -> Any:
    """MuJoCo's `MjModel` of a file, sensors off, since nobody reads them.

    Args:
        path: The MJCF file.
        settings: Integrator, cone and solver; None keeps those of the file, which are MuJoCo's
            defaults where the file has none.
    """
    mujoco = require("mujoco", "to run MuJoCo beside stepper")
    model = mujoco.MjModel.from_xml_path(path)
    if settings is not None:
        settings.configure(mujoco, model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    return model


class MujocoCrowd:
    """MuJoCo's own way to step many, `mujoco.batch.Batch`, sensors off.

    Args:
        path: The MJCF file.
        num_envs: Number of environments.
        threads: Threads; 0 is one per core.
        settings: As of `mujoco_model`.
    """

    def __init__(self, path: str, num_envs: int, *, threads: int = 1, settings: MujocoEngine | None = None) -> None:
        model = mujoco_model(path, settings)
        batch = require("mujoco.batch", "to run MuJoCo beside stepper")
        self.name = f"MuJoCo {settings.setting if settings else 'defaults'}"
        self.num_envs = num_envs
        self._batch: Any = batch.Batch(model, num_envs, nthread=threads)
        self._ctrl: Array = self._batch.bind("ctrl")

    @property
    def qpos(self) -> Array:
        """See `Crowd.qpos`."""
        return np.array(self._batch.bind("qpos"))

    @property
    def qvel(self) -> Array:
        """See `Crowd.qvel`."""
        return np.array(self._batch.bind("qvel"))

    def step(self, ctrl: Array) -> None:
        """See `Crowd.step`."""
        self._ctrl[:] = ctrl
        self._batch.step()

    def record(self, phase: str) -> None:
        """MuJoCo says nothing of its steps."""


@dataclass(frozen=True)
class Measured:
    """What the referee found in some environments at one moment.

    Attributes:
        contacts: Touching pairs of geoms per environment, mean.
        penetration: Deepest overlap, m.
        kinetic_mean: Kinetic energy, mean, J.
        kinetic_max: Kinetic energy, largest, J.
    """

    contacts: float
    penetration: float
    kinetic_mean: float
    kinetic_max: float


class Referee:
    """Measures states of any engine with one yardstick: MuJoCo's collision detection and inertia matrix at the given qpos, qvel.

    Points nearer than `NEAR` to where the pair's contact pushes (the surface, or the model's margin above it) count as touching, so that
    neither an engine that rests a micrometre above the floor nor one that sinks in gains by it.
    """

    NEAR = 1e-4

    def __init__(self, path: str) -> None:
        self._mujoco = require("mujoco", "to measure both engines alike")
        self._model = self._mujoco.MjModel.from_xml_path(path)
        # A gap as wide as what the margin grows by: contacts are found further away, and push where they did.
        self._model.geom_margin[:] += 10 * self.NEAR
        self._model.geom_gap[:] += 10 * self.NEAR
        self._data = self._mujoco.MjData(self._model)

    def measure(self, qpos: Array, qvel: Array) -> Measured:
        """Measures environments.

        Args:
            qpos: (n, nq).
            qvel: (n, nv).

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
