"""Real tosses of two links with a hinge. As with the cube, each engine is fitted to one half of them, and predicts the other half."""

from dataclasses import dataclass

import numpy as np
from atlas.engines import DEFAULTS, Mujoco, Stepper
from atlas.mjcf import numbers
from stepper.lab.engines import MujocoEngine

from reality.cube import Experiment
from reality.data import ELBOW_CENTRE, ELBOW_HALF, ELBOW_HINGE, PERIOD, elbow_bodies, elbow_tosses
from reality.engines import OfAtlas, Table, TossEngine

MASS, INERTIA = 0.37, 0.0006167
"""Mass of a link, kg, and its moments of inertia, kg m^2, as published: nominal values, not measured ones."""


@dataclass(frozen=True)
class Elbow(Table):
    """Differences of the experiment with the elbow from its nominal description, and the friction of the hinge.

    Attributes:
        inertia: Moments of inertia of both links in relation to the published ones.
        hinge_damping: Viscous friction of the hinge, N m s/rad.
        hinge_friction: Dry friction of the hinge, N m.
    """

    inertia: float = 1.0
    hinge_damping: float = 0.0
    hinge_friction: float = 0.0

    def mjcf(self, geom: str, option: str = "") -> str:
        """Model of the table and both links in MJCF. Links touch the table alone, as in the published description."""

        def link(centre: tuple[float, ...]) -> str:
            inertial = f'<inertial pos="{numbers(centre)}" mass="{MASS}" diaginertia="{numbers([self.inertia * INERTIA] * 3)}"/>'
            if not self.radius:
                return f'{inertial}<geom type="box" size="{numbers(ELBOW_HALF)}" pos="{numbers(centre)}"/>'
            corners = (ELBOW_HALF - self.radius) * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) + centre
            return inertial + "".join(f'<geom type="sphere" size="{self.radius!r}" pos="{numbers(corner)}"/>' for corner in corners)

        hinge = f'<joint axis="0 1 0" damping="{self.hinge_damping!r}" frictionloss="{self.hinge_friction!r}"/>'
        return f"""<mujoco><option gravity="{numbers([0, 0, -self.gravity])}">{option}</option>
          <default><geom contype="1" conaffinity="2" {geom}/></default><worldbody>
          <geom type="plane" size="5 5 1" contype="2" conaffinity="1" pos="{numbers([0, 0, self.offset])}"/>
          <body name="first"><freejoint/>{link((0.0, 0.0, 0.0))}
          <body name="second" pos="{numbers(ELBOW_HINGE)}">{hinge}{link(ELBOW_CENTRE)}</body></body></worldbody></mujoco>"""


ELBOW = Experiment(
    "elbow_toss",
    0.05,
    Elbow,
    elbow_tosses,
    elbow_bodies,
    {"offset": (-0.003, 0.003), "radius": (0.0005, 0.006), "inertia": (0.3, 1.5)},
    {"hinge_damping": (0.0, 0.006), "hinge_friction": (0.0, 0.015)},
    samples=2 + round(0.1 / PERIOD),
    draws=32,
    rounds=16,
    continued=True,
)
"""Tosses of the elbow. Errors are those of the first 0.1 s after the first contact."""


def engines() -> list[TossEngine]:
    """Engines that toss the elbow."""
    friction = {"friction": (0.05, 0.5)}
    return [
        OfAtlas("stepper", friction | {"restitution": (0.0, 0.5)}, engine=Stepper("stepper")),
        OfAtlas("stepper, compliant table", friction | {"log stiffness": (2.5, 5.5), "log damping": (0.3, 3.0)}, engine=Stepper("stepper")),
        OfAtlas(
            "MuJoCo, elliptic cone",
            friction | {"log stiffness": (3.0, 6.5), "log damping": (1.0, 3.7), "impedance": (0.1, 0.98)},
            engine=Mujoco("MuJoCo", MujocoEngine("elliptic", DEFAULTS | {"cone": "elliptic"})),
        ),
    ]
