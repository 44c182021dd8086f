"""Scenes 1, 2, 7 and 26: impacts."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, ball, document, free
from atlas.scene import Engine, Scene, flat
from atlas.world import Array

# Scenes 1 and 2: a block on a vertical slide, which touches the floor at joint position 0.

STEP, E = 0.02, 0.25
BLOCK = document('<geom name="floor" type="plane" size="0 0 1"/><body name="block" pos="0 0 0.1"><joint type="slide" axis="0 0 1"/>'
                 '<geom type="box" size=".1 .1 .1" mass="1"/></body>')  # fmt: skip


def recursion(h: float, v: float, steps: int) -> list[tuple[float, float]]:
    """Heights and velocities of a bouncing block by a textbook's recursion, from the initial height h (m) and velocity v (m/s).

    Each step of length dt sets v to v - g dt, and then h to h + v dt. If h is then below the floor, it sets h to 0 and v to -e v, where e
    is the restitution.
    """
    out = []
    for _ in range(steps):
        v -= G * STEP
        h += v * STEP
        if h < 0:
            h, v = 0.0, -E * v
        out.append((h, v))
    return out


def falling(engine: Engine, dt: float) -> float:
    """Error of scene 1, a block that falls on the floor: largest deviation of height (m) or velocity (m/s) in eight steps.

    The deviation is that from the textbook's `recursion`.
    """
    world = engine.start(BLOCK, dt, restitution=E)
    world.set([0.20], [-0.10])
    worst = 0.0
    for h, v in recursion(0.20, -0.10, 8):
        world.step()
        worst = max(worst, abs(world.qpos[0, 0] - h), abs(world.qvel[0, 0] - v))
    return worst


def one_step(engine: Engine, dt: float) -> float:
    """Error of scene 2, a block that hits the floor: error of its velocity after one step, m/s."""
    world = engine.start(BLOCK, dt, restitution=E)
    world.set([0.005], [-1.5])
    world.step()
    return abs(float(world.qvel[0, 0]) - E * (1.5 + G * STEP))


# Scene 7: a ball falls from the height H. With restitution e, its n-th apex is at e^(2n) H.

RADIUS, DROP, BOUNCE = 0.1, 0.9, 0.5


def apexes(engine: Engine, dt: float, e: float, heights: Array, count: int) -> float:
    """Error of scenes 7 and 35, balls that fall from some heights (m) and bounce with restitution e.

    The error is the largest error of the heights of the first `count` apexes, over all initial heights, m. The height of an apex follows
    from the energy, which is constant in flight, after the step in which the ball passes it.
    """
    world = engine.start(document(FLOOR + free("ball", ball(RADIUS, 1.0), (0, 0, RADIUS + 1.0))), dt, len(heights), restitution=e)
    qpos = world.qpos.copy()
    qpos[:, 2] = RADIUS + heights
    world.set(qpos, np.zeros((len(heights), 6)))
    found, worst, before = np.zeros(len(heights), int), 0.0, np.zeros(len(heights))
    for _ in range(round(2.0 / dt)):
        world.step()
        z, v = world.qpos[:, 2] - RADIUS, world.qvel[:, 2]
        at = (before > 0) & (v <= 0) & (found < count)
        found[at] += 1
        errors = np.abs(z + v**2 / (2 * G) - e ** (2 * found) * heights)
        worst, before = max(worst, float(errors[at].max(initial=0.0))), v
        if (found == count).all():
            return worst
    return math.inf


# Scene 26: five balls in a row without gravity (Newton's cradle); the first one has speed V.

BALLS, V = 5, 0.5


def cradle(gap: float) -> str:
    """MJCF of scene 26, Newton's cradle: equal balls on a line, with gaps of `gap` m. The first ball starts 5 cm farther away."""
    row = "".join(free(f"ball{k}", ball(RADIUS, 1.0), (k * (2 * RADIUS + gap) - (0.05 if k == 0 else 0.0), 0, 0)) for k in range(BALLS))
    return document(row, gravity=(0, 0, 0))


def _strike(engine: Engine, dt: float, gap: float) -> np.ndarray:
    """Velocities of the balls of Newton's cradle along their line after all impacts, (BALLS,) m/s."""
    world = engine.start(cradle(gap), dt, restitution=1.0)
    qvel = np.zeros((1, 6 * BALLS))
    qvel[0, 0] = V
    world.set(world.qpos, qvel)
    world.run((0.05 + BALLS * gap) / V + 0.5)
    return world.qvel[0, ::6]


def conservation_error(engine: Engine, dt: float) -> float:
    """Error of scene 26 with touching balls: relative error of total momentum or of kinetic energy after the impact, the larger one."""
    v = _strike(engine, dt, 0.0)
    return float(max(abs(v.sum() / V - 1.0), abs((v**2).sum() / V**2 - 1.0)))


def sequential_impact_error(engine: Engine, dt: float) -> float:
    """Error of scene 26 with separated balls, in which each ball hits the next one: largest error of a ball's final velocity, m/s.

    The first ball has speed V, and only the last one must move in the end, with the same speed.
    """
    v = _strike(engine, dt, 0.03)
    return float(np.abs(v - [0, 0, 0, 0, V]).max())


ONCE = (STEP,)
NEWTON = "Newton's law of impact"
ROUND = "a hundred operations on numbers of order 1"

SCENES = (
    Scene(
        "1",
        "falling block",
        "the textbook recursion; after 8 steps h 0.0427, v -1.6696",
        "the recursion itself",
        "m, m/s",
        flat(1e-12),
        ROUND,
        falling,
        ONCE,
        ONCE,
    ),
    Scene(
        "2",
        "one step into the floor",
        "-1.6962 m/s before the contact, +0.4241 after it",
        "by hand",
        "m/s",
        flat(1e-12),
        ROUND,
        one_step,
        ONCE,
        ONCE,
    ),
    Scene(
        "7",
        "apexes of a bounce, e 0.5",
        "e^(2n) H",
        NEWTON,
        "m",
        lambda dt: 2 * dt * math.sqrt(2 * G * DROP),
        "twice the motion of a step at impact speed, as the impact is up to a step early or late",
        partial(apexes, e=BOUNCE, heights=np.array([DROP]), count=3),
    ),
    Scene(
        "26",
        "Newton's cradle, touching",
        "momentum and energy are conserved",
        "conservation laws",
        "1",
        flat(2e-5),
        "twice a solver residual of 1e-6 m/s in each of five speeds, relative to the speed of the first ball",
        conservation_error,
    ),
    Scene(
        "26",
        "Newton's cradle, 3 cm apart",
        "the last ball leaves with the speed of the first",
        NEWTON + " for two equal balls",
        "m/s",
        flat(1e-6),
        "the solver's tolerance",
        sequential_impact_error,
    ),
)
