"""Scenes 12, 14, 15 and 17: stacks of boxes, a table with four legs, and a pyramid of overlapping boxes."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, box, document, free
from atlas.scene import Engine, Scene, flat
from atlas.scenes.friction import CREEP, NO_CREEP
from atlas.world import World

HALF = 0.05
COUNT = 10
RATIOS = (100, 200, 300, 1000)
SWEEP = (5e-4, 2e-3, 5e-3, 2e-2)
"""Time steps of the stacks, s: fewer than usual, as stacks are the slowest scenes."""


def tower(top: float) -> str:
    """MJCF of scene 12: a stack of ten boxes of 10 cm. Nine have 1 kg, and the top one has `top` kg."""
    masses = [1.0] * (COUNT - 1) + [float(top)]
    boxes = (free(f"box{k}", box((HALF,) * 3, m), (0, 0, HALF * (2 * k + 1))) for k, m in enumerate(masses))
    return document(FLOOR + "".join(boxes), friction=0.5)


def weights(engine: Engine, dt: float, top: float) -> float:
    """Error of scene 12, a stack of ten boxes with a top box of `top` kg.

    The error is the largest relative error of a force after two seconds: that between two boxes, or on the floor. The right force is the
    weight of the boxes above.
    """
    world = engine.start(tower(top), dt)
    world.run(2.0)
    names = ["world"] + [f"box{k}" for k in range(COUNT)]
    worst = 0.0
    for k in range(COUNT):
        above = (COUNT - 1 - k + top) * G
        worst = max(worst, abs(world.normal_force((names[k], names[k + 1])) / above - 1.0))
    return worst


def moved(engine: Engine, dt: float, mjcf: str, seconds: float) -> float:
    """Error of free bodies that must stand: largest displacement of a body after a time in s, at most `LONGEST` steps, m."""
    world = engine.start(mjcf, dt)
    start = world.qpos.reshape(-1, 7)[:, :3]
    world.step(min(round(seconds / dt), LONGEST))
    return float(np.linalg.norm(world.qpos.reshape(-1, 7)[:, :3] - start, axis=1).max())


LONGEST = 30_000
"""Largest number of steps: a minute at 2 ms. With smaller time steps the run is shorter than a minute."""


def on_two(engine: Engine, dt: float) -> float:
    """Error of scene 12, two small boxes below a box 20 times their size: relative error of a total force after two seconds.

    The total forces are that on both small boxes and that under them; the error is the larger one. Each small box has four contact points,
    so statics determines only their sum. One box may carry up to a ninth more than the other.
    """
    s, big, deep = 0.05, 1.0, 0.05
    density = 1000.0
    small_mass, big_mass = 8 * s * s * deep * density, 8 * big * big * deep * density
    world = engine.start(
        document(
            FLOOR
            + free("left", box((s, deep, s), small_mass), (s - big, 0, s))
            + free("right", box((s, deep, s), small_mass), (big - s, 0, s))
            + free("big", box((big, deep, big), big_mass), (0, 0, 2 * s + big)),
            friction=0.5,
        ),
        dt,
    )
    world.run(2.0)
    load = sum(world.normal_force((small, "big")) for small in ("left", "right"))
    below = sum(world.normal_force(("world", small)) for small in ("left", "right"))
    return max(abs(load / (big_mass * G) - 1.0), abs(below / ((big_mass + 2 * small_mass) * G) - 1.0))


def steady(engine: Engine, dt: float) -> float:
    """Error of scene 14, a stack of ten equal boxes: largest mean speed of a box over 99,000 steps (m/s), or largest final velocity.

    The final velocity is in m/s or rad/s, and the error is the larger of the two.
    """
    world = engine.start(tower(1.0), dt)
    world.step(1000)
    start = world.qpos.reshape(COUNT, 7)[:, :3]
    steps = 99_000
    world.step(steps)
    moved = np.linalg.norm(world.qpos.reshape(COUNT, 7)[:, :3] - start, axis=1).max()
    return float(max(moved / (steps * dt), np.abs(world.qvel).max()))


# Scene 15: one body with four feet. The distribution of its weight over the feet is not unique; the sum and the motion are.

LEGS = ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2))
TABLE_MASS = 7.0


def table(order: tuple[int, ...]) -> str:
    """MJCF of scene 15: a plate on four spherical feet. `order` is the order in which the feet 0 to 3 are listed in the file."""
    feet = "".join(f'<geom type="sphere" size=".02" mass="0" pos="{LEGS[k][0]} {LEGS[k][1]} -.38"/>' for k in order)
    plate = '<geom type="box" size=".35 .25 .02" contype="0" conaffinity="0" mass="0"/>'
    inertia = f'<inertial pos="0.02 0.01 -0.05" mass="{TABLE_MASS}" diaginertia="0.4 0.5 0.6"/>'
    return document(FLOOR + f'<body name="table" pos="0 0 0.4"><freejoint/>{inertia}{plate}{feet}</body>', friction=0.4)


def table_forces(engine: Engine, dt: float) -> float:
    """Error of scene 15, a table with four feet: relative error of the sum of the normal forces of the feet, after two seconds."""
    world = engine.start(table((0, 1, 2, 3)), dt)
    world.run(2.0)
    return abs(world.normal_force() / (TABLE_MASS * G) - 1.0)


def table_order(engine: Engine, dt: float) -> float:
    """Error of scene 15, a table that slides for half a second: largest difference of its final position between orders of its feet, m.

    The feet are listed in several orders in the MJCF, which must not affect the motion.
    """
    places = []
    for order in ((0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)):
        world = engine.start(table(order), dt)
        world.push("table", (0.6 * TABLE_MASS * G, 0.1 * TABLE_MASS * G, 0.0), (0.0, 0.0, 0.5))
        world.run(0.5)
        places.append(world.qpos[0, :3])
    return float(np.ptp(places, axis=0).max())


# Scene 17: a pyramid of four rows; each box overlaps the boxes below, or the floor, by a quarter of its height.

PYRAMID = 0.1
OVERLAP = 0.25


def pyramid() -> str:
    """MJCF of scene 17: a pyramid of ten overlapping boxes of 1 kg."""
    text = ""
    for row in range(4):
        for k in range(4 - row):
            at = ((k - (3 - row) / 2) * 2 * PYRAMID * 1.02, 0.0, PYRAMID + 2 * PYRAMID * (1 - OVERLAP) * row - 2 * PYRAMID * OVERLAP)
            text += free(f"box{row}{k}", box((PYRAMID,) * 3, 1.0), at)
    return document(FLOOR + text, friction=0.5)


def pops(engine: Engine, dt: float) -> float:
    """Error of scene 17, overlapping boxes that separate: largest kinetic energy during the separation.

    The energy is relative to the work of lifting all ten boxes by the depth of one overlap. The error is infinite if the boxes do not
    separate within three seconds.
    """
    world, every = engine.start(pyramid(), dt), max(dt, 5e-3)
    worst = world.worst(lambda: world.kinetic()[0], max(1, round(3.0 / every)), every)
    return worst / (10 * G * 2 * PYRAMID * OVERLAP) if _apart(world) else math.inf


def _apart(world: World) -> bool:
    """Whether the boxes of scene 17's pyramid stand in four rows, without overlap beyond a hundredth of their size."""
    heights = np.sort(world.qpos.reshape(10, 7)[:, 2])
    rows = [heights[:4], heights[4:7], heights[7:9], heights[9:]]
    centres = [PYRAMID * (2 * row + 1) for row in range(4)]
    return all(np.abs(h - c).max() < 0.02 * PYRAMID for h, c in zip(rows, centres, strict=True))


def share(dt: float) -> float:
    """Largest relative error of a force in a stack that counts as correct, at the time step `dt`, s.

    This tolerance is ten times (once per contact of the stack) a solver residual of 1e-6 m/s, divided by the velocity g dt that gravity
    adds in a step.
    """
    return max(1e-6, 10 * 1e-6 / (G * dt))


SHARE = "ten times a solver residual of 1e-6 m/s, relative to the load of a step, g dt"
STATICS = "statics"

SCENES = (
    *(
        Scene(
            "12",
            f"ten boxes, the top one {r} times heavier",
            "each interface carries the weight above",
            STATICS,
            "1",
            share,
            SHARE,
            partial(weights, top=r),
            SWEEP,
            (2e-3,),
        )
        for r in RATIOS
    ),
    Scene(
        "12",
        "the same, 1000 times, for a minute",
        "stands",
        STATICS,
        "m",
        flat(1e-4),
        "ten interfaces of 1e-5 m, the penetration allowed at rest",
        partial(moved, mjcf=tower(1000), seconds=60.0),
        (2e-3, 1e-2),
        (1e-2,),
    ),
    Scene(
        "12",
        "a box on two of a twentieth of its size",
        "the small boxes carry the weight",
        STATICS,
        "1",
        share,
        SHARE,
        on_two,
        SWEEP,
        (2e-3, 2e-2),
    ),
    Scene(
        "14", "ten equal boxes for 1e5 steps", "no drift, no jitter", STATICS, "m/s", flat(CREEP), NO_CREEP, steady, (2e-3, 2e-2), (2e-2,)
    ),
    Scene("15", "table of four legs: forces", "the sum is m g", STATICS, "1", share, SHARE, table_forces),
    Scene(
        "15",
        "table of four legs: order",
        "the motion does not depend on the order of contacts",
        "invariance under renaming of contacts",
        "m",
        lambda dt: 1e-6,
        "a solver residual of 1e-6 m/s over half a second, half of it for each of four feet",
        table_order,
    ),
    Scene(
        "17",
        "overlap of 25 % at the start",
        "the boxes separate with almost no kinetic energy",
        "rigid bodies store no energy",
        "1",
        flat(0.01),
        "a hundredth of the work of lifting the pyramid by the overlap",
        pops,
        SWEEP,
        (2e-3, 2e-2),
    ),
)
