"""Both engines as batches that begin where a script says; `stepper.lab.demo` has what they share with other races."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from stepper import Model, Options
from stepper._options import Precision
from stepper.lab.engines import Certificate, EngineBatch, MujocoBatch, StepperBatch

from many_contacts.scene import Array, Script


@dataclass
class Effort:
    """What the solver did in a phase.

    Attributes:
        certificate: What the steps said of themselves.
        sweeps: Sum of sweeps over environment-steps.
        newton_steps: Sum of Newton steps over environment-steps.
    """

    certificate: Certificate = field(default_factory=Certificate)
    sweeps: int = 0
    newton_steps: int = 0


class Batch(EngineBatch, Protocol):
    """Environments of one engine that can begin anew."""

    def begin(self, script: Script) -> None:
        """Puts all environments where the script begins."""

    def restart(self, mask: NDArray[np.bool_], qpos: Array) -> None:
        """Puts some environments (num_envs,) at rest at configurations (num_envs, nq)."""

    def move(self, mocap: Array) -> None:
        """Puts the mocap bodies at poses (num_envs, nmocap, 7)."""

    @property
    def failed(self) -> int:
        """Environments of which the engine gave up a state since `begin`."""


class Ours(StepperBatch):
    """stepper, one thread; arguments as of `StepperBatch`."""

    def __init__(self, model: Model, num_envs: int, *, precision: Precision, options: Options | None, setting: str) -> None:
        super().__init__(model, num_envs, precision=precision, options=options, setting=setting)
        self.efforts: dict[str, Effort] = {}

    def begin(self, script: Script) -> None:
        """See `Batch.begin`."""
        n = self.num_envs
        self.sim.reset(qpos=script.qpos[:n], qvel=None if script.qvel is None else script.qvel[:n])
        if script.push is not None:
            self.sim.xfrc_applied[:] = script.push

    def restart(self, mask: NDArray[np.bool_], qpos: Array) -> None:
        """See `Batch.restart`."""
        self.sim.reset(mask, qpos=qpos)

    def move(self, mocap: Array) -> None:
        """See `Batch.move`."""
        self.sim.mocap_pos[:] = mocap[..., :3]
        self.sim.mocap_quat[:] = mocap[..., 3:]

    def record(self, phase: str) -> None:
        """See `EngineBatch.record`."""
        effort = self.efforts.setdefault(phase, Effort())
        effort.certificate.add(self.sim)
        newton_steps = int(np.sum(self.sim.newton_steps))
        effort.sweeps += int(np.sum(self.sim.iterations)) - newton_steps
        effort.newton_steps += newton_steps

    @property
    def failed(self) -> int:
        """See `Batch.failed`."""
        return sum(effort.certificate.non_finite for effort in self.efforts.values())


class Theirs(MujocoBatch):
    """MuJoCo, one thread."""

    def begin(self, script: Script) -> None:
        """See `Batch.begin`."""
        n = self.num_envs
        self.reset(script.qpos[:n], None if script.qvel is None else script.qvel[:n])
        if script.push is not None:
            self.bind("xfrc_applied")[:] = script.push

    def restart(self, mask: NDArray[np.bool_], qpos: Array) -> None:
        """See `Batch.restart`."""
        self.bind("qpos")[mask] = qpos[mask]
        for name in ("qvel", "qacc_warmstart"):
            self.bind(name)[mask] = 0.0

    def move(self, mocap: Array) -> None:
        """See `Batch.move`."""
        self.bind("mocap_pos")[:] = mocap[..., :3]
        self.bind("mocap_quat")[:] = mocap[..., 3:]

    @property
    def failed(self) -> int:
        """See `Batch.failed`."""
        return int(np.count_nonzero(self.restarted))


PGS = Options(solver="pgs")
"""Sweeps alone."""
LAW = Options(contact="mujoco")
"""MuJoCo's law of contact, with the integrator that the scene asks for."""
