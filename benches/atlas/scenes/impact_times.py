"""Scenes 34 and 35: impacts at any time within a step."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import G, ball, document, free
from atlas.scene import Engine, Scene
from atlas.scenes.impacts import NEWTON, apexes

# Scene 34: a billiard ball collides with an equal one at rest, without friction and elastically. In five environments it starts at
# different distances, so that the collision is at five different times within a step.

BALL, MASS, SPEED, CUT, PHASES = 0.03, 0.17, 5.0, math.radians(30), 5
"""Radius, m; mass, kg; initial speed, m/s; angle between initial velocity and line of centres, rad; number of environments."""


def billiards(engine: Engine, dt: float) -> float:
    """Error of scene 34, an elastic collision of two balls: largest error of a velocity after the collision, relative to the initial speed.

    In the five environments the collision is at different times within a step.
    """
    aside = 2 * BALL * math.sin(CUT)
    pair = free("cue", ball(BALL, MASS), (-0.2, -aside, 0)) + free("object", ball(BALL, MASS), (0, 0, 0))
    world = engine.start(document(pair, friction=0.0, gravity=(0, 0, 0)), dt, PHASES, restitution=1.0)
    qpos, qvel = world.qpos.copy(), np.zeros((PHASES, 12))
    qpos[:, 0] -= np.arange(PHASES) / PHASES * SPEED * dt
    qvel[:, 0] = SPEED
    world.set(qpos, qvel)
    world.run(0.3 / SPEED)
    normal = np.array([math.cos(CUT), math.sin(CUT), 0])
    struck = SPEED * math.cos(CUT) * normal
    exact = np.concatenate([np.array([SPEED, 0, 0]) - struck, struck])
    found = world.qvel[:, [0, 1, 2, 6, 7, 8]]
    return float(np.abs(found - exact).max()) / SPEED


# Scene 35: a ball falls from twenty heights H, so that it hits the floor at twenty different times within a step. With restitution e, its
# n-th apex is at e^(2n) H.

HEIGHTS = 0.5 + 0.5 * np.arange(20) / 20
"""Initial heights of the ball's lowest point, m."""
DTS = (1e-4, 5e-4, 2e-3, 5e-3, 1e-2)
COEFFICIENTS = (0.3, 0.5, 0.8, 1.0)

SCENES = (
    Scene(
        "34",
        "billiards at 30 degrees",
        "the object ball leaves along the line of centres with v cos 30, the cue ball across it with v sin 30",
        NEWTON + ", e 1",
        "1",
        lambda dt: 0.1 * (SPEED * dt / (2 * BALL)) ** 2,
        "a tenth of the square of the angle by which a ball moves in a step, seen from the other ball: second order",
        billiards,
        DTS,
        DTS,
    ),
    *(
        Scene(
            "35",
            f"apexes from twenty heights, e {e:g}",
            "e^(2n) H",
            NEWTON,
            "m",
            lambda dt: G * dt**2,
            "twice the motion of a step from rest: second order",
            partial(apexes, e=e, heights=HEIGHTS, count=2),
            DTS,
            DTS,
        )
        for e in COEFFICIENTS
    ),
)
