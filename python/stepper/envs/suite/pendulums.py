"""dm_control's pendulum, acrobot and cartpole."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from stepper._stepper import Model
from stepper.envs.assets import cache_model, load_quietly
from stepper.envs.observations import Observation
from stepper.envs.suite.base import SuiteTask, norm, rotation, rotations, source_tree, tolerance
from stepper.envs.task import Array, Reset, TaskView

_UPRIGHT = float(np.cos(np.deg2rad(8.0)))
"""Cosine of the largest rewarded angle from upright."""


@dataclass(frozen=True, kw_only=True)
class Pendulum(SuiteTask):
    """Task: swing the pendulum up with little torque, and hold it there."""

    file = "pendulum.xml"
    frame_skip: int = 1

    def observations(self) -> tuple[Observation, ...]:
        """Cosine, sine and velocity of the angle: (3,)."""
        return (
            Observation("orientation", func=lambda now: rotation(now, "pole")[:, [2, 0], 2]),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 within 8 degrees of upright, else 0."""
        return tolerance(rotation(now, "pole")[:, 2, 2], _UPRIGHT, 1.0)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with a uniform random angle."""
        reset.qpos[:] = reset.rng.uniform(-np.pi, np.pi, 1)


_TARGET = 0.2
"""Radius of the target, m."""


@dataclass(frozen=True, kw_only=True)
class Acrobot(SuiteTask):
    """Task: swing the tip of a two-link arm up to a target, and hold it there.

    Attributes:
        sparse: Whether the reward is sparse: 1 in the target, 0 elsewhere.
    """

    file = "acrobot.xml"
    frame_skip: int = 1
    sparse: bool = False

    def observations(self) -> tuple[Observation, ...]:
        """Sines and cosines of the angles of both links from the vertical, and joint velocities: (6,)."""
        return (
            Observation("horizontal", func=lambda now: rotations(now)[:, 1:, 0, 2]),
            Observation("vertical", func=lambda now: rotations(now)[:, 1:, 2, 2]),
            Observation("velocity", func=lambda now: now.qvel, unit="rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: 1 with the tip in the target. Outside, the score decreases with the distance; with `sparse` it is 0."""
        target, tip = (now.site_xpos[:, now.sim.model.site(name).id] for name in ("target", "tip"))
        return tolerance(norm(target - tip), 0.0, _TARGET, margin=0.0 if self.sparse else 1.0)

    def reset(self, reset: Reset) -> None:
        """Initial states: at rest, with uniform random angles."""
        reset.qpos[:] = reset.rng.uniform(-np.pi, np.pi, 2)


@dataclass(frozen=True, kw_only=True)
class Cartpole(SuiteTask):
    """Task: balance the poles of a cart. Episodes start near balance, or with hanging poles if `swing_up` is True.

    Attributes:
        swing_up: Whether the first pole starts hanging down.
        sparse: Whether the reward is 1 near balance and 0 elsewhere, instead of smooth.
        poles: Number of poles, one on top of the other.
    """

    file = "cartpole.xml"
    frame_skip: int = 1
    swing_up: bool = False
    sparse: bool = False
    poles: int = 1

    def model(self) -> Model:
        """Model of the cart with its poles."""
        return _scene(self.poles)

    def observations(self) -> tuple[Observation, ...]:
        """Position of the cart, cosines and sines of the poles' angles, and velocities: (2 + 3 poles,)."""
        return (
            Observation("cart", func=lambda now: now.qpos[:, :1], unit="m"),
            Observation("poles", func=lambda now: rotations(now)[:, 2:, [2, 0], 2]),
            Observation("velocity", func=lambda now: now.qvel, unit="m/s, rad/s"),
        )

    def score(self, now: TaskView) -> Array:
        """Score: product of terms for upright and slow poles, a centred cart and small controls.

        With `sparse` it is 1 if the cart is near the centre and all poles are nearly upright, else 0.
        """
        cart, upright = now.qpos[:, 0], rotations(now)[:, 2:, 2, 2]
        if self.sparse:
            inside: Array = tolerance(cart, -0.25, 0.25) * tolerance(upright, 0.995, 1.0).prod(axis=1)
            return inside
        centered = (1.0 + tolerance(cart, margin=2.0)) / 2.0
        control = (4.0 + tolerance(now.action[:, 0], margin=1.0, fall="quadratic", value=0.0)) / 5.0
        slow = (1.0 + tolerance(now.qvel[:, 1:], margin=5.0).min(axis=1)) / 2.0
        reward: Array = ((upright + 1.0) / 2.0).mean(axis=1) * control * slow * centered
        return reward

    def reset(self, reset: Reset) -> None:
        """Initial states: near balance, or at the centre with the first pole hanging down."""
        if self.swing_up:
            reset.qpos[:] = reset.rng.normal(reset.qpos.shape[1])
            reset.qpos[:, :2] *= 0.01
            reset.qpos[:, 2:] *= 0.1
            reset.qpos[:, 1] += np.pi
        else:
            reset.qpos[:, :1] = reset.rng.uniform(-0.1, 0.1, 1)
            reset.qpos[:, 1:] = reset.rng.uniform(-0.034, 0.034, reset.qpos.shape[1] - 1)
        reset.qvel[:] = 0.01 * reset.rng.normal(reset.qvel.shape[1])


@cache_model
def _scene(poles: int) -> Model:
    """Model of dm_control's cart with this number of poles."""
    if poles < 1:
        raise ValueError(f"poles is {poles}, must be at least 1")
    tree = source_tree("cartpole.xml")
    parent = tree.find("./worldbody/body/body")
    floor = tree.find("./worldbody/geom")
    if parent is None or floor is None:
        raise ValueError("dm_control's cartpole.xml has no pole or no floor: this version of dm_control is not supported")
    for k in range(2, poles + 1):
        child = ElementTree.SubElement(parent, "body", name=f"pole_{k}", pos="0 0 1", childclass="pole")
        ElementTree.SubElement(child, "joint", name=f"hinge_{k}")
        ElementTree.SubElement(child, "geom", name=f"pole_{k}")
        parent = child
    if poles > 1:
        floor.set("pos", f"0 0 {1 - poles - 0.05}")
    return load_quietly(tree)
