"""dm_control's finger, which spins a body on a hinge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.streams import Draws
from stepper.envs.suite.base import SuiteTask, randomize_without_overlap, reading, scene
from stepper.envs.task import Array, Moment, Quantity

_SPEED = 15.0
"""From which on it spins, rad/s."""
_DAMPING = 0.03
"""Of the hinge that is spun, N m s/rad."""


@dataclass(frozen=True, kw_only=True)
class Finger(SuiteTask):
    """Keep the body spinning."""

    file = "finger.xml"
    frame_skip: int = 2

    def model(self) -> Model:
        """The scene, with less damping of the hinge than the file has."""
        model = scene(self.file)
        damping = np.array(model.dof_damping)
        damping[model.joint("hinge").dofadr] = _DAMPING
        return model.replace(dof_damping=damping)

    def quantities(self) -> tuple[Quantity, ...]:
        """Angles of the finger, the tip beside the hinge, velocities, logarithms of the forces at its two pads: (9,)."""
        return (
            Quantity("angles", of=lambda now: reading(now, "proximal", "distal")),
            Quantity("tip", of=lambda now: (reading(now, "tip") - reading(now, "spinner"))[:, ::2]),
            Quantity("velocity", of=lambda now: reading(now, "proximal_velocity", "distal_velocity", "hinge_velocity")),
            Quantity("touch", of=lambda now: np.log1p(reading(now, "touchtop", "touchbottom"))),
        )

    def score(self, now: Moment) -> Array:
        """1 where it spins, one way."""
        spins: Array = (reading(now, "hinge_velocity")[:, 0] <= -_SPEED).astype(np.float64)
        return spins

    def start(self, qpos: Array, qvel: Array, draws: Draws) -> None:
        """At rest, with angles within their limits, where nothing touches."""
        randomize_without_overlap(scene(self.file), qpos, draws)
