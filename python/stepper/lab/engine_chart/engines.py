"""Engines on a chart: what starts a run of a scene at a time step with settings."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options, Precision
from stepper._stepper import Stepper
from stepper.loading import load
from stepper.shared.machine import require

Array = NDArray[np.float64]


class Run(Protocol):
    """One scene in one engine at one time step. All environments of a run do the same."""

    @property
    def num_envs(self) -> int:
        """Environments stepped together; the cost is quoted for one of them."""

    @property
    def qpos(self) -> Array:
        """Configuration of the first environment, (nq,)."""

    def reset(self, qpos: Array, qvel: Array) -> None:
        """Starts from a configuration (nq,) and a velocity (nv,), with nothing left of what was before."""

    def advance(self, nstep: int) -> None:
        """Makes `nstep` steps in one call. This is the call that is timed."""


class Engine(Protocol):
    """A way to step: an engine with its settings."""

    @property
    def engine(self) -> str:
        """Name of the engine, one colour family on the chart."""

    @property
    def setting(self) -> str:
        """Its settings in a few words, one line on the chart."""

    def start(self, mjcf: str, dt: float) -> Run:
        """Loads a scene, with time step `dt` in s."""


@dataclass(frozen=True)
class StepperEngine:
    """Ours.

    Attributes:
        setting: Its name on the chart.
        options: Settings of the step; the time step is set by the sweep.
        batch: Environments stepped together; None is a single one.
        precision: "f64" or "f32".
    """

    setting: str
    options: Options = field(default_factory=Options)
    batch: int | None = None
    precision: Precision = "f64"
    engine: str = "stepper"

    def start(self, mjcf: str, dt: float) -> Run:
        """See `Engine.start`."""
        return _StepperRun(mjcf, dataclasses.replace(self.options, timestep=dt), self.batch, self.precision)


_load = lru_cache(maxsize=8)(load)


class _StepperRun:
    def __init__(self, mjcf: str, options: Options, batch: int | None, precision: Precision) -> None:
        self._sim = Stepper(_load(mjcf), batch, options=options, precision=precision)

    @property
    def num_envs(self) -> int:
        return self._sim.num_envs or 1

    @property
    def qpos(self) -> Array:
        qpos: Array = np.asarray(self._sim.qpos, dtype=np.float64).reshape(self.num_envs, -1)
        first: Array = qpos[0]
        return first

    def reset(self, qpos: Array, qvel: Array) -> None:
        self._sim.reset(qpos=qpos, qvel=qvel)

    def advance(self, nstep: int) -> None:
        self._sim.step(nstep=nstep)


@dataclass(frozen=True)
class MujocoEngine:
    """MuJoCo, by `mujoco.mj_step(m, d, nstep)`, without sensors.

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

    def start(self, mjcf: str, dt: float) -> Run:
        """See `Engine.start`."""
        mujoco = require("mujoco", "to draw MuJoCo beside stepper")
        model = mujoco.MjModel.from_xml_string(mjcf)
        self.configure(mujoco, model)
        model.opt.timestep = dt
        return _MujocoRun(mujoco, model)

    def configure(self, mujoco: Any, model: Any) -> None:
        """Writes these settings into an `MjModel`; its time step stays."""
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator}")
        model.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{self.cone}")
        model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{self.solver}")
        model.opt.impratio = self.impratio
        model.opt.noslip_iterations = self.noslip
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR


class _MujocoRun:
    num_envs = 1

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._mujoco = mujoco
        self._model = model
        self._data = mujoco.MjData(model)

    @property
    def qpos(self) -> Array:
        return np.array(self._data.qpos, dtype=np.float64)

    def reset(self, qpos: Array, qvel: Array) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = qpos
        self._data.qvel[:] = qvel

    def advance(self, nstep: int) -> None:
        self._mujoco.mj_step(self._model, self._data, nstep)
