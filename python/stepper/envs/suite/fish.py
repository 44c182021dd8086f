"""dm_control's fish: a swimming robot in a fluid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, rotation, tolerance
from stepper.envs.task import Array, Reset, TaskView
from stepper.shared.rotations import matrices
from stepper.shared.view import per_moment

_JOINTS = ("tail1", "tail_twist", "tail2", "finright_roll", "finright_pitch", "finleft_roll", "finleft_pitch")


@dataclass(frozen=True, kw_only=True)
class Fish(SuiteTask):
    """Task: turn upright, or swim to a target.

    Attributes:
        swim: Whether the task is to swim to a target.
    """

    file = "fish.xml"
    frame_skip: int = 10
    swim: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Joint angles, cosine of the tilt, target in the frame of the mouth (only if the task is to swim), velocities: (24,) or (21,)."""
        return (
            Observation("joint_angles", func=_angles, unit="rad"),
            Observation("upright", func=lambda now: rotation(now, "torso")[:, 2, 2]),
            *([Observation("target", func=_to_target, unit="m")] if self.swim else []),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: a term for an upright torso.

        If the task is to swim, the score is the sum of 1/8 of this term and 7/8 of a term for the distance to the target.
        """
        upright = rotation(now, "torso")[:, 2, 2]
        if not self.swim:
            return tolerance(upright, 1.0, 1.0, margin=1.0)
        model = now.sim.model
        radii = float(model.geom("mouth").size[0] + model.geom("target").size[0])
        return (7.0 * tolerance(norm(_to_target(now)), 0.0, radii, margin=2.0 * radii) + 0.5 * (upright + 1.0)) / 8.0

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with a random orientation and small random angles; with `swim`, a random target in a box."""
        quat = reset.rng.normal(4)
        reset.qpos[:, 3:7] = quat / norm(quat)[:, None]
        model = self.model()
        for name in _JOINTS:
            at = model.joint(name).qposadr
            reset.qpos[:, at : at + 1] = reset.rng.uniform(-0.2, 0.2, 1)
        if self.swim:
            target = np.hstack([reset.rng.uniform(-0.4, 0.4, 2), reset.rng.uniform(0.1, 0.3, 1)])
            reset.sim.randomize({"geom_pos[target]": target}, envs=reset.envs)


def _angles(now: TaskView) -> Array:
    """Joint angles, (num_envs, 7), rad."""
    angles: Array = now.qpos[:, [now.sim.model.joint(name).qposadr for name in _JOINTS]]
    return angles


@per_moment
def _to_target(now: TaskView) -> Array:
    """Vector from the mouth to the target, in the frame of the mouth, m: (num_envs, 3)."""
    model = now.sim.model
    mouth = model.geom("mouth").id
    difference = now.geom_xpos[:, model.geom("target").id] - now.geom_xpos[:, mouth]
    local: Array = np.einsum("ni,nij->nj", difference, matrices(now.geom_xquat[:, mouth]))
    return local
