"""Scene 42: a ball in a groove touches both sides at once."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import G, ball, document, free, numbers, surface
from atlas.scene import Engine, Scene, flat
from atlas.world import World

RADIUS, HALF = 0.1, 2.0
"""Radius of the ball, and half size of the square surface whose triangles form a groove, m."""
OPENING = math.pi / 3
"""Angle between the vertical and each side, rad."""
SLOPE, SPEED, SECONDS = 0.2, 0.5, 1.0
"""Slope of the groove, rad; initial speed, m/s; simulated time, s."""


def _start(engine: Engine, dt: float, kind: str, friction: float, slope: float) -> World:
    """Environment with a ball in a groove along x. Gravity is tilted by `slope` (rad), so that +x is downhill."""
    if kind == "planes":
        turn = (math.pi / 2 - OPENING) / 2
        sides = [(math.cos(turn), sign * math.sin(turn), 0, 0) for sign in (1, -1)]
        assets, geom = "", "".join(f'<geom type="plane" size="0 0 1" quat="{numbers(q)}"/>' for q in sides)
    else:
        y = np.linspace(-HALF, HALF, 41)
        assets, geom = surface(HALF, np.tile((np.abs(y) / math.tan(OPENING))[:, None], (1, 41)), kind)
    at = (-1.5, 0, RADIUS / math.sin(OPENING))
    pull = (G * math.sin(slope), 0, -G * math.cos(slope))
    return engine.start(document(geom + free("ball", ball(RADIUS, 1.0), at), friction=friction, gravity=pull, before=assets), dt)


def level(engine: Engine, dt: float, kind: str) -> float:
    """Error of scene 42 with a ball that glides along a level groove without friction for a second: relative change of its velocity.

    `kind` is the kind of groove: "planes", "hfield" or "mesh".
    """
    world = _start(engine, dt, kind, 0.0, 0.0)
    world.set(qvel=[SPEED, 0, 0, 0, 0, 0])
    world.run(SECONDS)
    return float(np.linalg.norm(world.qvel[0, :3] - [SPEED, 0, 0])) / SPEED


def downhill(engine: Engine, dt: float, kind: str, rolls: bool) -> float:
    """Error of scene 42 with a ball that starts at rest in an inclined groove: relative error of its distance after a second.

    Half the opening angle of the groove is a, and the ball's radius is r. Both contacts are at the distance r sin(a) from the rotation
    axis. Rolling with angular velocity w gives the speed w r sin(a), and the acceleration g sin(slope) / (1 + 2/5 / sin^2(a)).
    """
    world = _start(engine, dt, kind, 1.0 if rolls else 0.0, SLOPE)
    begin = float(world.qpos[0, 0])
    world.run(SECONDS)
    turning = 0.4 / math.sin(OPENING) ** 2 if rolls else 0.0
    expected = G * math.sin(SLOPE) / (1 + turning) * SECONDS**2 / 2
    return abs((float(world.qpos[0, 0]) - begin) / expected - 1.0)


ROUNDING = "f32: rounding of 500 steps"
STEP = "two steps per second: a first-order integrator starts up to a step early or late"
KINDS = (("planes", "planes"), ("hfield", "a height field"), ("mesh", "a mesh"))

SCENES = tuple(
    scene
    for kind, name in KINDS
    for scene in (
        Scene("42", f"along a groove of {name}", "constant speed", "no friction", "1", flat(1e-5), ROUNDING, partial(level, kind=kind)),
        Scene(
            "42",
            f"sliding down a groove of {name}",
            "g sin(a) t^2 / 2",
            "constant acceleration",
            "1",
            lambda dt: 2 * dt,
            STEP,
            partial(downhill, kind=kind, rolls=False),
        ),
        Scene(
            "42",
            f"rolling down a groove of {name}",
            "a = g sin(a) / (1 + 2/5 / sin^2(opening))",
            "rolling about a chord of the ball",
            "1",
            lambda dt: 2 * dt,
            STEP,
            partial(downhill, kind=kind, rolls=True),
        ),
    )
)
