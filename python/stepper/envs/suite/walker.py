"""dm_control's walker: a planar biped."""

from __future__ import annotations

from dataclasses import dataclass

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, randomize_joints, reading, rotations, tolerance
from stepper.envs.task import Array, Reset, TaskView

_HEIGHT = 1.2
"""Height of the torso at which the walker counts as standing, m."""


@dataclass(frozen=True, kw_only=True)
class Walker(SuiteTask):
    """Task: stand, or move to the right at a speed.

    Attributes:
        move_speed: Speed that earns the full reward of 1, m/s; 0 to stand.
    """

    file = "walker.xml"
    frame_skip: int = 10
    move_speed: float = 0.0

    def observations(self) -> tuple[Observation, ...]:
        """Cosines and sines of the bodies' angles, height of the torso, velocities: (24,)."""
        return (
            Observation("orientations", func=lambda now: rotations(now)[:, 1:, 0, ::2]),
            Observation("height", func=lambda now: now.xpos[:, 1, 2:], unit="m"),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: term for height and upright posture, times a term for the speed if `move_speed` is not 0."""
        standing = tolerance(now.xpos[:, 1, 2], _HEIGHT, float("inf"), margin=_HEIGHT / 2.0)
        stand: Array = (3.0 * standing + (1.0 + rotations(now)[:, 1, 2, 2]) / 2.0) / 4.0
        if self.move_speed == 0.0:
            return stand
        speed, wanted = reading(now, "torso_subtreelinvel")[:, 0], self.move_speed
        return stand * (5.0 * tolerance(speed, wanted, float("inf"), margin=wanted / 2.0, fall="linear", value=0.5) + 1.0) / 6.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles within their limits and a random torso angle."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
