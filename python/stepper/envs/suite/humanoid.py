"""dm_control's two humanoids, which stand or move at a speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_without_overlap, reading, rotation, small_control, tolerance
from stepper.envs.task import Array, Reset, TaskView

_HEIGHT = 1.4
"""Height of the head at which the humanoid counts as standing, m."""


@dataclass(frozen=True, kw_only=True)
class Humanoid(SuiteTask):
    """Task: stand, or move at a speed in any direction.

    Attributes:
        move_speed: Speed that earns the full reward of 1, m/s; 0 to stand.
        pure_state: Whether the observation is qpos and qvel only.
    """

    file = "humanoid.xml"
    torso: ClassVar[str] = "torso"
    """Name of the body that should be upright."""
    upwards: ClassVar[int] = 2
    """Axis of the torso (0, 1 or 2) that points upwards in the upright pose."""
    extremities: ClassVar[tuple[str, ...]] = ("left_hand", "left_foot", "right_hand", "right_foot")
    """Bodies whose positions relative to the torso are observed."""
    frame_skip: int = 5
    move_speed: float = 0.0
    pure_state: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, head height, extremities, vertical and velocities: (67,). With `pure_state`: qpos and qvel, (55,).

        The positions of the extremities (hands and feet) and the vertical direction are in the frame of the torso. The velocities are
        the velocity of the centre of mass, and qvel.
        """
        velocity = Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s")
        if self.pure_state:
            return (Observation("position", func=lambda now: now.qpos, unit="m, rad"), velocity)
        return (
            Observation("joint_angles", func=lambda now: now.qpos[:, 7:], unit="rad"),
            Observation("head_height", func=_head_height, unit="m"),
            Observation("extremities", func=_extremities, unit="m"),
            Observation("torso_vertical", func=lambda now: rotation(now, self.torso)[:, 2]),
            Observation("com_velocity", func=lambda now: reading(now, f"{self.torso}_subtreelinvel"), unit="m/s"),
            velocity,
        )

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for head height, upright torso, small controls, and speed."""
        standing = tolerance(_head_height(now), _HEIGHT, float("inf"), margin=_HEIGHT / 4.0)
        upright = tolerance(rotation(now, self.torso)[:, 2, self.upwards], 0.9, float("inf"), margin=1.9, fall="linear", value=0.0)
        velocity = reading(now, f"{self.torso}_subtreelinvel")[:, :2]
        if self.move_speed == 0.0:
            moving: Array = tolerance(velocity, margin=2.0).mean(axis=1)
        else:
            wanted = self.move_speed
            moving = (5.0 * tolerance(norm(velocity), wanted, float("inf"), margin=wanted, fall="linear", value=0.0) + 1.0) / 6.0
        reward: Array = (4.0 + small_control(now)) / 5.0 * standing * upright * moving
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random angles and a random orientation, without contacts."""
        randomize_without_overlap(self.model(), reset.qpos, reset.rng)


def _head_height(now: TaskView) -> Array:
    """Height of the head, (num_envs,), m."""
    height: Array = now.xpos[:, now.sim.model.body("head").id, 2]
    return height


def _extremities(now: TaskView) -> Array:
    """Positions of hands and feet in the frame of the torso, m: (num_envs, 4, 3)."""
    model, task = now.sim.model, now.task
    bodies = [model.body(name).id for name in task.extremities]
    apart = now.xpos[:, bodies] - now.xpos[:, [model.body(task.torso).id]]
    extremities: Array = np.einsum("nbi,nij->nbj", apart, rotation(now, task.torso))
    return extremities


@dataclass(frozen=True, kw_only=True)
class HumanoidCMU(Humanoid):
    """Tasks of `Humanoid` with dm_control's humanoid for CMU motion capture. The torso is the body "thorax"; its y axis points upwards."""

    file = "humanoid_CMU.xml"
    torso = "thorax"
    upwards = 1
    extremities = ("lhand", "lfoot", "rhand", "rfoot")
    frame_skip: int = 10
