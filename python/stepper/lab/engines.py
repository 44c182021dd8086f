"""Engines that are compared: environments of one model in stepper or in MuJoCo, stepped together behind one interface."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options, Precision
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.loading import load
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

    def reset(self, qpos: Array, qvel: Array | None = None) -> None:
        """Resets all environments to qpos, (num_envs, nq) or (nq,), and qvel, of the same form or zero. Clears controls and warm starts."""

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """Makes steps with controls (num_envs, nu), or with those in force. This is the call that is timed."""

    def record(self, phase: str) -> None:
        """Records status and residual of the last step under `phase`. Not timed."""


@dataclass
class Certificate:
    """Status flags and residuals of steps over a phase of a run.

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
    """Batch of environments in stepper.

    Args:
        model: Model of all environments.
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

    def reset(self, qpos: Array, qvel: Array | None = None) -> None:
        """See `Crowd.reset`."""
        self.sim.reset(qpos=qpos, qvel=qvel)

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """See `Crowd.step`."""
        self.sim.step(ctrl, nstep)

    def record(self, phase: str) -> None:
        """See `Crowd.record`."""
        self.certificates.setdefault(phase, Certificate()).add(self.sim)


class MujocoCrowd:
    """Batch of environments in MuJoCo, `mujoco.batch.Batch`.

    Args:
        model: MuJoCo's `MjModel`, which is copied.
        num_envs: Number of environments.
        threads: Threads; 0 is one per core.
        setting: Name of the settings in tables.
        contacts: Whether `data` has the contacts of the last step, for which each environment keeps an `MjData`.
        library: Module with the class `Batch`.
    """

    def __init__(
        self, model: Any, num_envs: int, *, threads: int = 1, setting: str = "", contacts: bool = False, library: str = "mujoco.batch"
    ) -> None:
        self.name, self.num_envs = f"MuJoCo {setting}".strip(), num_envs
        self._batch: Any = require(library, "to run MuJoCo beside stepper").Batch(model, num_envs, threads, *([True] if contacts else []))
        self._bound: dict[str, Array] = {}
        for name in ("qpos", "qvel", "ctrl"):
            self.bind(name)

    @classmethod
    def from_file(cls, path: str, num_envs: int, *, threads: int = 1, settings: MujocoEngine | None = None) -> Self:
        """MuJoCo's environments of an MJCF file, with settings as of `mujoco_model`."""
        return cls(mujoco_model(path, settings), num_envs, threads=threads, setting=settings.setting if settings else "defaults")

    @property
    def qpos(self) -> Array:
        """See `Crowd.qpos`."""
        return np.array(self._bound["qpos"])

    @property
    def qvel(self) -> Array:
        """See `Crowd.qvel`."""
        return np.array(self._bound["qvel"])

    def reset(self, qpos: Array, qvel: Array | None = None) -> None:
        """See `Crowd.reset`."""
        self._batch.reset(stage=require("mujoco", "to run MuJoCo").mjtStage.mjSTAGE_NONE.value)
        self.bind("qpos")[:] = qpos
        if qvel is not None:
            self.bind("qvel")[:] = qvel

    def bind(self, name: str) -> Array:
        """A field of `MjData`, (num_envs, ...), which follows the steps; parts of the state may be written to."""
        if name not in self._bound:
            self._bound[name] = self._batch.bind(name)
        return self._bound[name]

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """See `Crowd.step`."""
        if ctrl is not None:
            self._bound["ctrl"][:] = ctrl
        self._batch.step(nstep=nstep)

    def record(self, phase: str) -> None:
        """Does nothing: MuJoCo reports no residual."""

    @property
    def restarted(self) -> NDArray[np.bool_]:
        """Environments that MuJoCo has reset by itself since `reset`, because a state was not finite or huge: (num_envs,)."""
        kinds = require("mujoco", "to run MuJoCo").mjtWarning
        bad = [kinds.mjWARN_BADQPOS.value, kinds.mjWARN_BADQVEL.value, kinds.mjWARN_BADQACC.value]
        found: NDArray[np.bool_] = self._batch.warning[:, bad, _NUMBER].any(axis=1)
        return found

    def data(self, env: int) -> Any:
        """A copy of the `MjData` of an environment; see `contacts`."""
        return self._batch.get_data(env)


_NUMBER = 1
"""Column of `Batch.warning` that counts warnings."""


def mujoco_model(path: str, settings: MujocoEngine | None = None) -> Any:
    """MuJoCo's `MjModel` of a file, without sensors, since nobody reads them.

    Args:
        path: The MJCF file.
        settings: Integrator, cone and solver; None keeps those of the file, or MuJoCo's defaults.
    """
    return configured(require("mujoco", "to run MuJoCo beside stepper").MjModel.from_xml_path(path), settings)


def configured(model: Any, settings: MujocoEngine | None) -> Any:
    """A model with settings written into it, without sensors."""
    mujoco = require("mujoco", "to run MuJoCo beside stepper")
    if settings is not None:
        settings.configure(mujoco, model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    return model


class Engine(Protocol):
    """A way to step: an engine with its settings."""

    @property
    def engine(self) -> str:
        """Name of the engine, one colour family on the chart."""

    @property
    def setting(self) -> str:
        """Settings in a few words, as a line of the chart."""

    def start(self, mjcf: str, dt: float) -> Crowd:
        """Loads a scene, with time step `dt` in s."""


@dataclass(frozen=True)
class StepperEngine:
    """Stepper with its settings.

    Attributes:
        setting: Its name on the chart.
        options: Settings of the step; the time step is set by the sweep.
        batch: Environments stepped together.
        precision: "f64" or "f32".
    """

    setting: str
    options: Options = field(default_factory=Options)
    batch: int = 1
    precision: Precision = "f64"
    engine: str = "stepper"

    def start(self, mjcf: str, dt: float) -> Crowd:
        """See `Engine.start`."""
        options = dataclasses.replace(self.options, timestep=dt)
        return StepperCrowd(_load(mjcf), self.batch, precision=self.precision, options=options)


_load = lru_cache(maxsize=8)(load)


@dataclass(frozen=True)
class MujocoEngine:
    """MuJoCo without sensors.

    Attributes:
        setting: Its name on the chart.
        integrator: "EULER", "IMPLICIT", "IMPLICITFAST", "DISCRETE" or "RK4".
        cone: "PYRAMIDAL" or "ELLIPTIC".
        solver: "NEWTON", "CG" or "PGS".
        impratio: Ratio of frictional to normal stiffness.
        noslip: Iterations of the noslip post-processing.
    """

    setting: str
    integrator: str = "EULER"
    cone: str = "PYRAMIDAL"
    solver: str = "NEWTON"
    impratio: float = 1.0
    noslip: int = 0
    engine: str = "MuJoCo"

    def start(self, mjcf: str, dt: float) -> Crowd:
        """See `Engine.start`."""
        model = require("mujoco", "to draw MuJoCo beside stepper").MjModel.from_xml_string(mjcf)
        model.opt.timestep = dt
        return MujocoCrowd(configured(model, self), 1)

    def configure(self, mujoco: Any, model: Any) -> None:
        """Writes these settings into an `MjModel`; its time step stays."""
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator}")
        model.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{self.cone}")
        model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{self.solver}")
        model.opt.impratio = self.impratio
        model.opt.noslip_iterations = self.noslip
