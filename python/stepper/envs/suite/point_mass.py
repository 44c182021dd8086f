"""dm_control's point mass, in a plane."""

from __future__ import annotations

from dataclasses import dataclass

from stepper.envs.streams import Draws
from stepper.envs.suite.base import SuiteTask, norm, randomize_joints, small_control, tolerance
from stepper.envs.task import Array, Moment, Quantity


@dataclass(frozen=True, kw_only=True)
class PointMass(SuiteTask):
    """Bring the mass to the middle."""

    file = "point_mass.xml"
    frame_skip: int = 1

    def quantities(self) -> tuple[Quantity, ...]:
        """Place and velocity: (4,)."""
        return (Quantity("position", of=lambda now: now.qpos), Quantity("velocity", of=lambda now: now.qvel))

    def score(self, now: Moment) -> Array:
        """1 in the target, less with the distance from it and with control."""
        model = now.sim.model
        target = model.geom("target")
        size = float(target.size[0])
        away = norm(now.geom_xpos[:, target.id] - now.geom_xpos[:, model.geom("pointmass").id])
        return tolerance(away, 0.0, size, margin=size) * (small_control(now) + 4.0) / 5.0

    def start(self, qpos: Array, qvel: Array, draws: Draws) -> None:
        """At rest, anywhere within the limits."""
        randomize_joints(self.model(), qpos, draws)
