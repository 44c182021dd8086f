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
        scale, nq, nv = self.reset_noise_scale, reset.qpos.shape[1], reset.qvel.shape[1]
        noise = reset.rng.uniform(-scale, scale, nq if self.normal_velocities else nq + nv)
        reset.qpos += noise[:, :nq]
        reset.qvel += scale * reset.rng.normal(nv) if self.normal_velocities else noise[:, nq:]
