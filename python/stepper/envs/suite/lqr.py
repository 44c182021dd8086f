"""dm_control's linear-quadratic regulator: masses in a row on springs, with actuators on the first ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SLIDES, SuiteTask, norm, source_tree
from stepper.envs.task import Array, Reset, TaskView

_STIFFNESS = (15.0, 25.0)
"""Least and largest stiffness of a spring, N/m."""
_CONTROL_COST = 0.1
"""Weight of the squared controls in the cost."""
_AT_REST = 1e-6
"""Norm of the vector of all positions (m) and velocities (m/s) below which an episode terminates."""


@dataclass(frozen=True, kw_only=True)
class LQR(SuiteTask):
    """Task: bring masses on springs to rest with small controls. Its episodes terminate at rest, and have no time limit.

    Controls have no bounds, and rewards no lower bound.

    Attributes:
        bodies: Number of masses.
        driven: Number of masses with an actuator: the first ones in the row.
        model_seed: Seed of the random springs. dm_control's environment with `task_kwargs={"random": model_seed}` has the same springs, bit
            for bit.
    """

    file = "lqr.xml"
    episode_steps = None
    frame_skip: int = 1
    bodies: int = 2
    driven: int = 1
    model_seed: int = 0

    def model(self) -> Model:
        """Model of the row of masses."""
        return _scene(self.bodies, self.driven, self.model_seed)

    def observations(self) -> tuple[Observation, ...]:
        """Positions and velocities: (2 bodies,)."""
        return SLIDES

    def score(self, now: TaskView) -> Array:
        """Score: 1 minus costs of positions and controls; velocities have no cost."""
        reward: Array = 1.0 - 0.5 * (norm(now.qpos) ** 2 + _CONTROL_COST * norm(now.action) ** 2)
        return reward

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """No bounds, as in dm_control: minus and plus infinity, (nu,) each."""
        return np.full(model.nu, -np.inf), np.full(model.nu, np.inf)

    def terminated(self, now: TaskView) -> Array:
        """Whether positions and velocities are practically zero, (num_envs,)."""
        at_rest: Array = norm(np.hstack([now.qpos, now.qvel])) < _AT_REST
        return at_rest

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with random positions on a sphere of radius sqrt(2)."""
        direction = reset.rng.normal(self.bodies)
        reset.qpos[:] = np.sqrt(2.0) * direction / norm(direction)[:, None]


@cache_model
def _scene(bodies: int, driven: int, seed: int) -> Model:
    """Model of masses in a row. dm_control's tendons, which only draw the springs, are left out."""
    if not 1 <= driven <= bodies:
        raise ValueError(f"driven is {driven} and bodies is {bodies}: at least one mass must be driven, and at most all of them")
    if not 0 <= seed < 2**32:
        raise ValueError(f"model_seed is {seed}, must be from 0 to 2**32 - 1")
    tree = source_tree(LQR.file)
    parent = tree.find("./worldbody")
    if parent is None:
        raise ValueError("dm_control's lqr.xml has no world: this version of dm_control is not supported")
    # dm_control also draws a damping after each stiffness, in the range [0, 0].
    stiffness = np.random.RandomState(seed).uniform(*_STIFFNESS, 2 * bodies)[::2]
    make = type(tree)
    actuators = make("actuator")
    tree.append(actuators)
    for k in range(bodies):
        child = make("body", name=f"body_{k}", pos=".25 0 0" if k else ".25 0 .1")
        child.append(make("joint", name=f"joint_{k}", stiffness=repr(float(stiffness[k]))))
        child.append(make("geom", name=f"geom_{k}"))
        if k < driven:
            actuators.append(make("motor", name=f"motor_{k}", joint=f"joint_{k}"))
        parent.append(child)
        parent = child
    return load_quietly(tree)
