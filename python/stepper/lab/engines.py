"""Common interface of stepper and MuJoCo for comparisons: batches of environments of one model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options, Precision
from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.lab.study import worlds
from stepper.shared.machine import require

Array = NDArray[np.float64]


@dataclass
class SolverStatistics:
    """Statistics of how well the steps in a phase of a run were solved.

    Attributes:
        env_steps: Number of steps, summed over environments.
        worst_residual: Largest residual of the solver, m/s.
        not_converged: Number of these steps with the flag NOT_CONVERGED.
        non_finite: Number of these steps with the flag NON_FINITE.
        contacts_full: Number of these steps with the flag CONTACTS_FULL.
        sweeps: Number of the solver's Gauss-Seidel iterations and Newton steps, summed over these steps.
    """

    env_steps: int = 0
    worst_residual: float = 0.0
    not_converged: int = 0
    non_finite: int = 0
    contacts_full: int = 0
    sweeps: int = 0

    def add(self, sim: Stepper) -> None:
        """Adds the status flags, residuals and iterations of the last step of a stepper to these statistics."""
        status = np.asarray(sim.status)
        self.env_steps += status.size
        self.worst_residual = max(self.worst_residual, float(np.max(sim.residual)))
        self.not_converged += int(np.count_nonzero(status & int(Status.NOT_CONVERGED)))
        self.non_finite += int(np.count_nonzero(status & int(Status.NON_FINITE)))
        self.contacts_full += int(np.count_nonzero(status & int(Status.CONTACTS_FULL)))
        self.sweeps += int(np.sum(sim.iterations))


class StepperBatch:
    """Batch of environments in stepper.

    Args:
        model: Model of all environments.
        num_envs: Number of environments.
        precision: "f64" or "f32".
        threads: Number of threads; 0 uses one per core.
        options: Options of the step; None selects the default options.
        setting: Name of the settings, for tables.
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
        self.solver_statistics: dict[str, SolverStatistics] = {}

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), m and rad."""
        return np.asarray(self.sim.qpos, dtype=np.float64)

    @property
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), m/s and rad/s."""
        return np.asarray(self.sim.qvel, dtype=np.float64)

    def reset(self, qpos: Array, qvel: Array | None = None) -> None:
        """Resets all environments to positions (num_envs, nq), m and rad, and velocities (num_envs, nv); None sets zero velocities."""
        self.sim.reset(qpos=qpos, qvel=qvel)

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """Steps all environments `nstep` times with controls (num_envs, nu), in the actuators' units; None keeps the last controls."""
        self.sim.step(ctrl, nstep)

    def record(self, phase: str) -> None:
        """Adds status flags and residuals of the last step to the statistics (`SolverStatistics`) of a phase of the run, such as "rest"."""
        self.solver_statistics.setdefault(phase, SolverStatistics()).add(self.sim)


class MujocoFields:
    """Access to the fields of a batch of MuJoCo environments, and to steps of the batch.

    Args:
        batch: A `mujoco.batch.Batch`.
        num_envs: Number of environments.
    """

    def __init__(self, batch: Any, num_envs: int):
        self._batch, self.num_envs = batch, num_envs
        self._bound: dict[str, Array] = {}

    def bind(self, name: str) -> Array:
        """Live view of a field of `MjData`, (num_envs, ...), in MuJoCo's unit. Fields of the state are writable."""
        if name not in self._bound:
            self._bound[name] = self._batch.bind(name)
        return self._bound[name]

    def step(self, ctrl: Array | None = None, nstep: int = 1) -> None:
        """Steps all environments with controls (num_envs, nu); None keeps the last controls."""
        if ctrl is not None:
            self.bind("ctrl")[:] = ctrl
        self._batch.step(nstep=nstep)


class MujocoBatch(MujocoFields):
    """Batch of environments in MuJoCo, `mujoco.batch.Batch`.

    Args:
        model: `mujoco.MjModel`, which the batch copies.
        num_envs: Number of environments.
        threads: Number of threads; 0 uses one per core.
        setting: Name of the settings in tables.
        contacts: Whether `data(env)` contains the contacts of the last step. This keeps an `MjData` per environment.
    """

    def __init__(self, model: Any, num_envs: int, *, threads: int = 1, setting: str = "", contacts: bool = False) -> None:
        self.name = f"MuJoCo {setting}".strip()
        library = require("mujoco.batch", "to compare stepper with MuJoCo")
        super().__init__(library.Batch(model, num_envs, threads, *([True] if contacts else [])), num_envs)
        for name in ("qpos", "qvel", "ctrl"):
            self.bind(name)

    @classmethod
    def from_file(cls, path: str, num_envs: int, *, threads: int = 1, settings: MujocoEngine | None = None) -> Self:
        """Batch of environments of an MJCF file in MuJoCo."""
        return cls(mujoco_model(path, settings), num_envs, threads=threads, setting=settings.setting if settings else "defaults")

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), m and rad."""
        return np.array(self._bound["qpos"])

    @property
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), m/s and rad/s."""
        return np.array(self._bound["qvel"])

    def reset(self, qpos: Array, qvel: Array | None = None) -> None:
        """Resets all environments to positions (num_envs, nq), m and rad, and velocities (num_envs, nv); None sets zero velocities."""
        self._batch.reset(stage=require("mujoco", "to run MuJoCo").mjtStage.mjSTAGE_NONE.value)
        self.bind("qpos")[:] = qpos
        if qvel is not None:
            self.bind("qvel")[:] = qvel

    def record(self, phase: str) -> None:
        """Do nothing, because MuJoCo reports no residual."""

    @property
    def restarted(self) -> NDArray[np.bool_]:
        """Whether MuJoCo has reset each environment by itself since `reset`, because its state was not finite or too large, (num_envs,)."""
        kinds = require("mujoco", "to run MuJoCo").mjtWarning
        bad = [kinds.mjWARN_BADQPOS.value, kinds.mjWARN_BADQVEL.value, kinds.mjWARN_BADQACC.value]
        found: NDArray[np.bool_] = self._batch.warning[:, bad, _WARNING_COUNT].any(axis=1)
        return found

    def data(self, env: int) -> Any:
        """Copy of the `MjData` of an environment. It has contacts only if the batch was created with `contacts=True`."""
        return self._batch.get_data(env)


EngineBatch: TypeAlias = StepperBatch | MujocoBatch
"""Batch of environments in one engine, stepped together. Benchmarks time only its method `step`."""
_WARNING_COUNT = 1
"""Column of `Batch.warning` with the number of warnings."""


@dataclass(frozen=True)
class MujocoEngine:
    """Settings of MuJoCo's step.

    Attributes:
        setting: Name of the settings, for tables.
        options: Options by name, as in settings of a study with engine="mujoco". Others keep the values of the model.
    """

    setting: str
    options: Mapping[str, Any]


def mujoco_model(path: str, settings: MujocoEngine | None = None) -> Any:
    """`mujoco.MjModel` of an MJCF file or of a compiled model (.mjb), with sensors disabled."""
    kind = require("mujoco", "to compare stepper with MuJoCo").MjModel
    model = kind.from_binary_path(path) if path.endswith(".mjb") else kind.from_xml_path(path)
    configure(model, settings)
    return model


def configure(model: Any, settings: MujocoEngine | None) -> None:
    """Writes settings into a `mujoco.MjModel`, and disables its sensors. With None, the model keeps its settings."""
    mujoco = require("mujoco", "to compare stepper with MuJoCo")
    worlds.configure(mujoco, model, settings.options if settings else {})
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
