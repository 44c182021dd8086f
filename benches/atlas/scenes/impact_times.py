"""Scenes 34 and 35: impacts at any time within a step."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, ball, document, free
from atlas.scene import Engine, Scene
from atlas.scenes.impacts import NEWTON

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

RADIUS, HEIGHTS, BOUNCES = 0.1, 0.5 + 0.5 * np.arange(20) / 20, 2
"""Radius of the ball, m; initial heights of its lowest point, m; number of apexes that are measured."""


def apexes(engine: Engine, dt: float, e: float) -> float:
    """Error of scene 35: balls that fall from twenty heights and bounce with restitution e.

    The error is the largest error of the heights of the first two apexes, over all initial heights, m.
    """
    world = engine.start(document(FLOOR + free("ball", ball(RADIUS, 1.0), (0, 0, RADIUS + 1.0))), dt, len(HEIGHTS), restitution=e)
    qpos = world.qpos.copy()
    qpos[:, 2] = RADIUS + HEIGHTS
    world.set(qpos, np.zeros((len(HEIGHTS), 6)))
    found, worst, before = np.zeros(len(HEIGHTS), int), 0.0, np.zeros(len(HEIGHTS))
    for _ in range(round(2.0 / dt)):
        world.step()
        z, v = world.qpos[:, 2] - RADIUS, world.qvel[:, 2]
        at = (before > 0) & (v <= 0) & (found < BOUNCES)
        found[at] += 1
        # Apex height from the energy, which is constant in flight.
        errors = np.abs(z + v**2 / (2 * G) - e ** (2 * found) * HEIGHTS)
        worst, before = max(worst, float(errors[at].max(initial=0.0))), v
        if (found == BOUNCES).all():
            return worst
    return math.inf


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
            partial(apexes, e=e),
            DTS,
            DTS,
        )
        for e in COEFFICIENTS
    ),
)
