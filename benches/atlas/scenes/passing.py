"""Scenes 43 and 44: bodies that pass close to others, and bodies that slide over the seams of small tiles."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import ball, box, document, free
from atlas.scene import Engine, Scene, flat

# Scene 43: free bodies fly past a box, without gravity.

GAP, FAST = 1.5e-3, 4.0
BLOCK = '<geom type="box" size=".3 .3 .3" pos=".3 0 -.3"/>'
FLYERS = {
    "a ball": (ball(0.02, 1.0), 0.02),
    "a box": (box((0.02, 0.02, 0.02), 1.0), 0.02),
    "a capsule": ('type="capsule" size=".02 .03" mass="1"', 0.05),
    "a cylinder": ('type="cylinder" size=".06 .03" mass="1"', 0.03),
}
"""Flying bodies of scene 43 by name: geom, and height of the body's origin above its lowest point, m."""


def near_miss(engine: Engine, dt: float, flyer: str) -> float:
    """Error of scene 43: a body, named in `FLYERS`, that flies past a box at 4 m/s, 1.5 mm above it.

    The error is the largest change of a velocity, m/s or rad/s.
    """
    geom, height = FLYERS[flyer]
    world = engine.start(document(BLOCK + free("flyer", geom, (-0.2, 0, height + GAP)), gravity=(0, 0, 0)), dt)
    start = np.array([FAST, 0, 0, 0, 0, 0])
    world.set(qvel=start)
    return world.worst(lambda: np.abs(world.qvel[0] - start).max(), math.ceil(1.0 / FAST / dt), dt)


# Scene 44: bodies slide and roll over tiles of 10 cm that lie flush, without friction.

SPEED = 1.0
TILE = '<geom type="box" size=".05 .5 .05" pos="{x!r} 0 -.05"/>'
SLIDERS = {
    "a ball": (ball(0.023, 1.0), 0.023),
    "a box": (box((0.02, 0.02, 0.02), 1.0), 0.02),
    "a cylinder": ('type="cylinder" size=".06 .03" mass="1"', 0.03),
}
"""Sliding bodies of scene 44, as in `FLYERS`."""


def small_tiles(engine: Engine, dt: float, slider: str) -> float:
    """Error of scene 44: a body, named in `SLIDERS`, that slides over ten seams of flush tiles without friction.

    The error is the relative change of the body's speed, or its largest change of height divided by 10 mm, the larger one.
    """
    geom, height = SLIDERS[slider]
    floor = "".join(TILE.format(x=0.1 * k) for k in range(-4, 20))
    world = engine.start(document(floor + free("slider", geom, (0, 0, height)), friction=0.0), dt)
    world.run(0.2)
    world.set(world.qpos[0], [SPEED, 0, 0, 0, 0, 0])
    rise = world.worst(lambda: abs(float(world.qpos[0, 2]) - height), math.ceil(1.0 / SPEED / dt), dt)
    return max(abs(float(world.qvel[0, 0]) / SPEED - 1.0), rise / 1e-2)


SCENES = (
    *(
        Scene(
            "43",
            f"{flyer} passes a box at 1.5 mm",
            "constant velocity",
            "Newton's first law",
            "m/s, rad/s",
            flat(1e-5),
            "rounding in single precision; 1e-9 in double precision",
            partial(near_miss, flyer=flyer),
        )
        for flyer in FLYERS
    ),
    *(
        Scene(
            "44",
            f"{slider} over ten seams of tiles of 10 cm",
            "no bump: at least 99.9 % of the speed, and a height within 0.01 mm",
            "a plane",
            "1",
            flat(1e-3),
            "0.1 % of the speed, 0.01 mm",
            partial(small_tiles, slider=slider),
            (5e-4, 1e-3, 2e-3, 5e-3, 2e-2),
            (1e-3, 5e-3),
        )
        for slider in SLIDERS
    ),
)
