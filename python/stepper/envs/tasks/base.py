"""Parts that several of Gymnasium's tasks share."""

from __future__ import annotations

from typing import ClassVar

from stepper.envs.task import MujocoTask, Reset


class NoisyTask(MujocoTask):
    """Task whose episodes begin at the reference pose, with noise on positions and velocities. Abstract."""

    reset_noise_scale: float
    normal_velocities: ClassVar[bool] = False
    """Whether the noise on velocities is normal instead of uniform."""

    def reset(self, reset: Reset) -> None:
        """Initial states: the reference pose with uniform noise on positions, and uniform or normal noise on velocities."""
        qpos, qvel, scale = reset.qpos, reset.qvel, self.reset_noise_scale
        nq, nv = qpos.shape[1], 0 if self.normal_velocities else qvel.shape[1]
        noise = reset.rng.uniform(-scale, scale, nq + nv)
        qpos += noise[:, :nq]
        qvel += noise[:, nq:] if nv else scale * reset.rng.normal(qvel.shape[1])
