"""Batches of environments in stepper and in MuJoCo that run the episode of a `Script`. `stepper.lab.engines` has their base classes.

Both have the same methods. `begin` sets all environments to the initial states of the script. `restart` resets the environments of a mask
(num_envs,), at rest in configurations (num_envs, nq). `move` sets the poses of the mocap bodies, (num_envs, nmocap, 7). `failed` is the
number of environments that the engine has reset, or of steps that were not finite, since the measurement began.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from stepper import Model, Options, Status, Stepper
from stepper._options import Precision
from stepper.lab.engines import MujocoBatch, SolverStatistics, StepperBatch

from many_contacts.scene import Array, Script


@dataclass
class Effort(SolverStatistics):
    """Work of the solver in a phase of an episode.

    Attributes:
        newton_steps: Number of the solver's Newton steps, summed over environment steps.
        flags: Number of environment steps with each status flag.
    """

    newton_steps: int = 0
    flags: Counter[str] = field(default_factory=Counter)

    def add(self, sim: Stepper) -> None:
        """Add the solver's work in the last step of a stepper, status flags included."""
        super().add(sim)
        self.newton_steps += int(np.sum(sim.newton_steps))
        status = np.asarray(sim.status)
        self.flags.update({str(flag.name): int(np.count_nonzero(status & flag)) for flag in Status})


class Ours(StepperBatch):
    """Batch of environments in stepper, with one thread; the arguments are those of `StepperBatch`."""

    def __init__(self, model: Model, num_envs: int, *, precision: Precision, options: Options | None, setting: str) -> None:
        super().__init__(model, num_envs, precision=precision, options=options, setting=setting)
        self.efforts: dict[str, Effort] = {}

    def begin(self, script: Script) -> None:
        """Set all environments to the initial states of the script."""
        n = self.num_envs
        self.sim.reset(qpos=script.qpos[:n], qvel=None if script.qvel is None else script.qvel[:n])
        if script.push is not None:
            self.sim.xfrc_applied[:] = script.push

    def restart(self, mask: NDArray[np.bool_], qpos: Array) -> None:
        """Reset the environments of a mask (num_envs,), at rest in configurations (num_envs, nq)."""
        self.sim.reset(mask, qpos=qpos)

    def move(self, mocap: Array) -> None:
        """Set the poses of the mocap bodies, (num_envs, nmocap, 7)."""
        self.sim.mocap_pos[:] = mocap[..., :3]
        self.sim.mocap_quat[:] = mocap[..., 3:]

    def record(self, phase: str) -> None:
        """Add the solver's work in the last step, status flags included, to the statistics of the phase of this name."""
        self.efforts.setdefault(phase, Effort()).add(self.sim)

    @property
    def failed(self) -> int:
        """Number of environment steps that stepper has marked as not finite since the measurement began."""
        return sum(effort.non_finite for effort in self.efforts.values())


class Theirs(MujocoBatch):
    """Batch of environments in MuJoCo, with one thread."""

    def begin(self, script: Script) -> None:
        """Set all environments to the initial states of the script."""
        n = self.num_envs
        self.reset(script.qpos[:n], None if script.qvel is None else script.qvel[:n])
        if script.push is not None:
            self.bind("xfrc_applied")[:] = script.push

    def restart(self, mask: NDArray[np.bool_], qpos: Array) -> None:
        """Reset the environments of a mask (num_envs,), at rest in configurations (num_envs, nq)."""
        self.bind("qpos")[mask] = qpos[mask]
        for name in ("qvel", "qacc_warmstart"):
            self.bind(name)[mask] = 0.0

    def move(self, mocap: Array) -> None:
        """Set the poses of the mocap bodies, (num_envs, nmocap, 7)."""
        self.bind("mocap_pos")[:] = mocap[..., :3]
        self.bind("mocap_quat")[:] = mocap[..., 3:]

    @property
    def failed(self) -> int:
        """Number of environments that MuJoCo has reset since the measurement began."""
        return int(np.count_nonzero(self.restarted))


PGS = Options(solver="pgs")
"""Options of stepper with the solver projected Gauss-Seidel, without Newton's method."""
FINE = Options(tolerance=1e-6)
"""Options of stepper with a hundredth of the default tolerance."""
LAW = Options(contact="mujoco")
"""Options of stepper with MuJoCo's contact law and the integrator of the model."""

Batch: TypeAlias = Ours | Theirs
"""Batch of environments of one engine."""
