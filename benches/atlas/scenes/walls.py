"""Scenes 21, 25, 27 and 28: walls, seams, fast bodies at thin walls, scenes far from the origin, extreme time steps."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, ball, box, document, free
from atlas.scene import LONG, Engine, Scene, flat
from atlas.scenes.stacks import STATICS

# Scene 21: a box is pushed into a wall; a box slides over a floor with seams.

PUSH = 20.0
CUBE = box((0.1, 0.1, 0.1), 1.0)


def flicker(engine: Engine, dt: float) -> float:
    """Error of scene 21, a box pushed into a wall: largest relative error of the wall's force in 200 steps, after a second of pushing."""
    wall = '<geom name="wall" type="box" size=".05 .5 .5" pos=".16 0 .5"/>'
    world = engine.start(document(FLOOR + wall + free("cube", CUBE, (0, 0, 0.1)), friction=0.0), dt)
    world.push("cube", (PUSH, 0, 0))
    world.run(1.0)
    return world.worst(lambda: abs(world.normal_force(("world", "cube"), (-1, 0, 0)) / PUSH - 1.0), 200, dt)


TILES = '<geom type="box" size=".1 .5 .05" pos="{x!r} 0 -.05"/>'
FIELD = '<asset><hfield name="flat" nrow="3" ncol="41" size="4 .5 .1 .1" elevation="{}"/></asset>'.format("0 " * 123)


def seams(engine: Engine, dt: float, kind: str) -> float:
    """Error of scene 21: for a second, a box slides without friction at 1 m/s over a floor with seams.

    The error is the largest of three changes: of height (m), of speed (m/s) and of pitch (rad). `kind` is "tiles" for a floor of boxes, or
    "field" for a height field.
    """
    if kind == "tiles":
        floor, before = "".join(TILES.format(x=0.2 * k) for k in range(-3, 10)), ""
    else:
        floor, before = '<geom type="hfield" hfield="flat"/>', FIELD
    world = engine.start(document(floor + free("cube", box((0.12, 0.12, 0.05), 1.0), (0.03, 0, 0.05)), friction=0.0, before=before), dt)
    world.run(0.5)
    start = world.qpos[0]
    world.set(start, [1.0, 0, 0, 0, 0, 0])

    def change() -> float:
        q, v = world.qpos[0], world.qvel[0]
        return max(abs(q[2] - start[2]), abs(v[0] - 1.0), 2 * abs(q[5] - start[5]))

    every = max(dt, 2e-3)
    return world.worst(change, round(1.0 / every), every)


# Scene 25: a sphere of 2 cm at 100 m/s, a wall of 2 mm.

RADIUS, THIN, FAST = 0.02, 0.001, 100.0


def tunnelling(engine: Engine, dt: float) -> float:
    """Error of scene 25, a fast sphere at a thin wall: largest penetration of the sphere beyond the near face of the wall, m."""
    wall = f'<geom type="box" size="{THIN} 1 1"/>'
    start = -0.5 * FAST * 0.02 - 0.3
    world = engine.start(document(wall + free("ball", ball(RADIUS, 0.1), (start, 0, 0)), gravity=(0, 0, 0)), dt)
    world.set(qvel=[FAST, 0, 0, 0, 0, 0])
    return world.worst(lambda: float(world.qpos[0, 0]) + RADIUS + THIN, math.ceil(0.05 / dt), dt)


# Scene 27: the same motion, shifted by 1e5 m along every axis.

FAR = 1e5
FAR_SECONDS = 1.0


def rounding_far_away(dt: float) -> float:
    """Tolerance of scene 27, far from the origin, for rounding at a time step, m.

    Each step rounds a coordinate twice, in integration and position correction, by at most half the spacing of numbers at `FAR`. Steady
    motion repeats its rounding, so that all errors may add up.
    """
    return math.ulp(FAR) * FAR_SECONDS / dt


def _final_positions(engine: Engine, dt: float, shift: float) -> np.ndarray:
    """Positions after a second of a rolling ball and of a box that slides to rest, in scene 27, (6,) m.

    The scene, with its floor, lies `shift` (m) from the origin along every axis. The result is relative to this shift.
    """
    at = np.full(3, shift)
    floor = f'<geom type="plane" size="0 0 1" pos="{shift!r} {shift!r} {shift!r}"/>'
    bodies = free("ball", ball(0.1, 1.0), np.add(at, (0, 1, 0.1))) + free("cube", box((0.1, 0.1, 0.05), 1.0), np.add(at, (0, 0, 0.05)))
    world = engine.start(document(floor + bodies, friction=0.3), dt)
    qvel = np.zeros(12)
    qvel[[0, 1, 6, 7]] = [2.0, 0.5, 1.0, 0.3]
    world.set(world.qpos[0], qvel)
    world.run(FAR_SECONDS)
    q = world.qpos[0]
    return np.concatenate([q[:3] - at, q[7:10] - at])


def far_away(engine: Engine, dt: float) -> float:
    """Error of scene 27: largest difference of a coordinate between the motion far from the origin and at the origin, m."""
    return float(np.abs(_final_positions(engine, dt, FAR) - _final_positions(engine, dt, 0.0)).max())


# Scene 28: the smallest and the largest time step. tests/api/test_stepper.py has input that makes no sense.


def extreme(engine: Engine, dt: float) -> float:
    """Error of scene 28, a falling box at an extreme time step: largest gain of energy in 2000 steps, relative to its initial energy."""
    world = engine.start(document(FLOOR + free("cube", CUBE, (0, 0, 0.5), (0.9, 0.2, 0.3, 0.1)), friction=0.5), dt)
    world.set(qvel=[0.5, 0, -1.0, 1.0, 2.0, 0.5])
    start = world.energy()[0]
    return world.worst(lambda: world.energy()[0] - start, 200, 10 * dt) / (G * 0.5)


SCENES = (
    Scene(
        "21",
        "pushed into a wall",
        "a steady force",
        STATICS,
        "1",
        lambda dt: max(1e-6, 1e-6 / (PUSH * dt)),
        "a solver residual of 1e-6 m/s, relative to the push of a step, F dt / m",
        flicker,
    ),
    Scene(
        "21",
        "sliding over seams of tiles",
        "no bump",
        "a plane",
        "m, m/s, rad",
        flat(1e-5),
        "1e-5 m, as for penetration",
        partial(seams, kind="tiles"),
    ),
    Scene(
        "21",
        "sliding over a flat height field",
        "no bump",
        "a plane",
        "m, m/s, rad",
        flat(1e-5),
        "1e-5 m, as for penetration",
        partial(seams, kind="field"),
        (5e-4, 2e-3, 2e-2),
        (2e-3, 2e-2),
    ),
    Scene("25", "fast sphere, thin wall", "does not pass", "rigid bodies", "m", flat(1e-5), "1e-5 m, as for penetration", tunnelling),
    Scene(
        "27",
        "far from the origin",
        "the same motion",
        "invariance under translation",
        "m",
        rounding_far_away,
        "64-bit numbers are 1.5e-11 m apart at 1e5 m, and a step rounds a coordinate twice: 7e-9 m in 500 steps",
        far_away,
    ),
    Scene(
        "28",
        "extreme time steps",
        "finite, no energy gained",
        "friction and inelastic impacts only dissipate",
        "1",
        flat(0.01),
        "1 % of the energy of the fall",
        extreme,
        (1e-6, *LONG, 0.1),
        (1e-6, 0.1),
    ),
)
