"""dm_control's point mass that moves in a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SLIDES, SuiteTask, norm, randomize_joints, small_control, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView, Terms

_PARALLEL = 0.9
"""Absolute cosine of the angle between the two control directions above which the second direction is drawn again."""


@dataclass(frozen=True, kw_only=True)
class PointMass(SuiteTask):
    """Task: bring the mass to the middle.

    Attributes:
        turned: Whether the directions of the two controls are random in each episode. The observation does not contain them.
    """

    file = "point_mass.xml"
    frame_skip: int = 1
    turned: bool = False

    def model(self) -> Model:
        """Model of the scene.

        If the task has random control directions (`turned`), the controls of the model have no bounds. The task combines two bounded
        actions into each control, which may exceed the bounds.
        """
        return _without_bounds() if self.turned else super().model()

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """Bounds of the actions, -1 and 1, (nu,) each."""
        return np.full(model.nu, -1.0), np.full(model.nu, 1.0)

    def observations(self) -> tuple[Observation, ...]:
        """Position and velocity: (4,)."""
        return SLIDES

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the mass in the target and without controls, decreasing with the distance and with the controls."""
        model = now.sim.model
        target = model.geom("target")
        size = float(target.size[0])
        away = norm(now.geom_xpos[:, target.id] - now.geom_xpos[:, model.geom("pointmass").id])
        return tolerance(away, 0.0, size, margin=size) * (small_control(now) + 4.0) / 5.0

    def episode_state(self, num_envs: int) -> Terms:
        """Direction of the force of each control, (num_envs, 2, 2), one per row: the axes, until `reset` draws random directions."""
        return {"directions": np.tile(np.eye(2), (num_envs, 1, 1))}

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, at a random position. With `turned`, draws directions of the controls that are not nearly parallel."""
        randomize_joints(self.model(), reset.qpos, reset.rng)
        if not self.turned:
            return
        rng, directions, again = reset.rng, reset.episode_state["directions"], np.ones(len(reset.envs), dtype=bool)
        directions[:, 0] = _unit(rng.normal(2))
        while again.any():
            directions[again, 1] = _unit(rng.of(again).normal(2))
            again[again] = np.abs(np.einsum("ni,ni->n", directions[again, 0], directions[again, 1])) > _PARALLEL

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action. With `turned`, each action pushes along the direction that `reset` has drawn for it."""
        control = now.action
        if self.turned:
            control = np.einsum("nk,nki->ni", np.clip(now.action, -1.0, 1.0), now.episode_state["directions"])
        now.sim.step(control, self.frame_skip)


def _unit(vectors: Array) -> Array:
    """Vectors (n, 2) divided by their norms."""
    units: Array = vectors / norm(vectors)[:, None]
    return units


@cache_model
def _without_bounds() -> Model:
    """Model of the point mass without control ranges."""
    tree = source_tree(PointMass.file)
    for motor in tree.iter("motor"):
        motor.attrib.pop("ctrlrange", None)
        motor.attrib.pop("ctrllimited", None)
    return load_quietly(tree)
