"""dm_control's planar stacker: an arm with a hand that stacks boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, randomize_without_overlap, tolerance
from stepper.envs.suite.manipulator import arm_observations, arm_scene, draw_arm, pose
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.streams import Rng

_CLOSE = 0.01
"""Margin of the score for a hand away from the target, m.

The score is 1 if the hand is at least 0.1 m from the target, and 0.1 at a distance of 0.1 m minus this margin.
"""
_MOST_BOXES = 4
"""Number of boxes in the file."""


@dataclass(frozen=True, kw_only=True)
class Stacker(SuiteTask):
    """Task: bring a box to a target, which may be on top of other boxes, and release it.

    The target is a mocap body with a random position in each episode.

    Attributes:
        boxes: Number of boxes, 1 to 4.
    """

    file = "stacker.xml"
    frame_skip: int = 10
    boxes: int = 2

    def model(self) -> Model:
        """Model of the arm with `boxes` boxes."""
        return _scene(self.boxes)

    def observations(self) -> tuple[Observation, ...]:
        """Arm and hand, touch sensors, boxes and target: (35 + 7 boxes,)."""
        return (
            *arm_observations(),
            Observation("box_pos", func=lambda now: np.stack([pose(now, box) for box in self._names], axis=1), unit="m"),
            Observation("box_vel", func=self._rates, unit="m/s, rad/s"),
            Observation("target_pos", func=lambda now: pose(now, "target")[:, :2], unit="m"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: product of a term for a box at the target and a term for the hand away from the target."""
        size = float(now.sim.model.geom("target").size[0])
        nearest = np.min([_to_target(now, box) for box in self._names], axis=0)
        away = tolerance(_to_target(now, "grasp"), 0.1, float("inf"), margin=_CLOSE)
        reward: Array = tolerance(nearest, margin=2.0 * size) * away
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random poses of arm and boxes, without contacts."""
        randomize_without_overlap(self.model(), reset.qpos, reset.rng, self._draw)
        model = reset.sim.model
        size, boxes_below = model.geom("target").size[0], np.floor(reset.rng.uniform(0.0, self.boxes, 1))
        at = model.body("target").mocapid
        reset.mocap_pos[:, at, 2:] = size * (2.0 * boxes_below + 1.0)
        reset.mocap_pos[:, at, :1] = reset.rng.uniform(-0.37, 0.37, 1)

    @property
    def _names(self) -> list[str]:
        """Names of the boxes, "box0" and so on."""
        return [f"box{k}" for k in range(self.boxes)]

    def _rates(self, now: TaskView) -> Array:
        """Velocities of the boxes, (num_envs, 3 * boxes): for each box along x (m/s), about y (rad/s) and along z (m/s)."""
        rates: Array = now.qvel[:, [now.sim.model.joint(f"{box}_{k}").dofadr for box in self._names for k in "xyz"]]
        return rates

    def _draw(self, model: Model, qpos: Array, rng: Rng) -> None:
        """Draws random positions of arm and boxes into qpos, (n, nq)."""
        draw_arm(model, qpos, rng)
        for box in self._names:
            for axis, low, high in (("x", 0.1, 0.3), ("z", 0.0, 0.7), ("y", 0.0, 2.0 * np.pi)):
                at = model.joint(f"{box}_{axis}").qposadr
                qpos[:, at : at + 1] = rng.uniform(low, high, 1)


def _to_target(now: TaskView, site: str) -> Array:
    """Distance of a site from the target, m: (num_envs,)."""
    model = now.sim.model
    return norm(now.site_xpos[:, model.site(site).id] - now.site_xpos[:, model.site("target").id])


@cache_model
def _scene(boxes: int) -> Model:
    """Model of dm_control's stacker with `boxes` boxes."""
    if not 1 <= boxes <= _MOST_BOXES:
        raise ValueError(f"boxes is {boxes}, must be from 1 to {_MOST_BOXES}")
    return arm_scene(Stacker.file, unused={f"box{k}" for k in range(boxes, _MOST_BOXES)}, placed={"target"})
