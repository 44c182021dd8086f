"""Scenes 3 to 6 and 32: Coulomb friction of one body on a plane or a tray."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, ball, box, document, free, incline
from atlas.scene import Engine, Scene, flat
from atlas.world import Array, World

BLOCK = box((0.2, 0.15, 0.05), 1.3)
HEIGHT = 0.05
CREEP = 1e-9
"""Speed below which a body counts as sticking, m/s: 3 cm a year. The rounding of g dt is 1e-15 m/s or less."""
NO_CREEP = "1e-9 m/s, 3 cm a year; rounding is 1e-15 m/s"
SETTLE = 200
"""Number of steps before a measurement, in which a cold start may converge and a soft contact may settle."""


def creep(world: World, steps: int, body: int = 0) -> float:
    """Mean speed of a free body's centre over `steps` steps, m/s, in the worst environment."""
    at = slice(7 * body, 7 * body + 3)
    world.step(SETTLE)
    start = world.qpos[:, at]
    world.step(steps)
    return float(np.linalg.norm(world.qpos[:, at] - start, axis=1).max() / (steps * world.dt))


# Scene 3. Below the friction angle nothing moves; above it a = g (sin theta - mu cos theta).

MU_INCLINE = 0.5
NEAR = math.radians(0.1)
CRITICAL = math.atan(MU_INCLINE)


def sticking(engine: Engine, dt: float, slope: float, mu: float, steps: int) -> float:
    """Error of scene 3, a box on an incline below the friction angle: creep speed over some steps, m/s."""
    return creep(engine.start(incline(BLOCK, HEIGHT, slope, mu), dt), steps)


def penetration_at_rest(engine: Engine, dt: float) -> float:
    """Error of scene 3: penetration of the lowest corner of a box on an incline of 10 degrees, m."""
    slope = math.radians(10)
    world = engine.start(incline(BLOCK, HEIGHT, slope, 1.0), dt)
    world.run(2.0)
    d = world.at()
    normal = np.array([math.sin(slope), 0.0, math.cos(slope)])
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (-HEIGHT, HEIGHT)])
    return float(max(0.0, -((d.xpos[1] + corners @ d.xmat[1].reshape(3, 3).T) @ normal).min()))


def sliding(engine: Engine, dt: float) -> float:
    """Error of scene 3, a sliding box: relative error of its acceleration a tenth of a degree above the friction angle.

    The exact acceleration is about g / 500 there.
    """
    slope = CRITICAL + NEAR
    right = G * (math.sin(slope) - MU_INCLINE * math.cos(slope))
    world = engine.start(incline(BLOCK, HEIGHT, slope, MU_INCLINE), dt)
    world.step(SETTLE)
    before = world.qvel[0, :3]
    steps = 10_000
    world.step(steps)
    return float(abs(np.linalg.norm(world.qvel[0, :3] - before) / (steps * dt) / right - 1.0))


# Scenes 4 to 6. With these speeds, sliding ends after a whole number of steps at every time step, as all time steps divide 20 ms.

COARSEST = 0.02
MU_BOX = 0.4
SPEED = 22 * MU_BOX * G * COARSEST
STOP = SPEED**2 / (2 * MU_BOX * G)


def extrapolated(way: Array, half: Array) -> Array:
    """Richardson extrapolation 2 x(h/2) - x(h) of distances, which removes the error of order h."""
    return 2 * half - way


def _stop(engine: Engine, dt: float, along: Array) -> Array:
    """Displacements of sliding boxes until they stop, (n, 2) m, for initial directions `along` (n, 2)."""
    world = engine.start(document(FLOOR + free("body", BLOCK, (0, 0, HEIGHT)), friction=MU_BOX), dt, len(along))
    world.step(SETTLE)
    start = world.qpos
    velocity = np.zeros((len(along), 6))
    velocity[:, :2] = SPEED * along
    world.set(start, velocity)
    world.run(1.2 * SPEED / (MU_BOX * G))
    return (world.qpos - start)[:, :2]


def stopping(engine: Engine, dt: float) -> float:
    """Error of scene 4, a sliding box: error of its stopping distance, extrapolated to the time step 0, m."""
    along = np.array([[math.cos(0.5), math.sin(0.5)]])
    way = extrapolated(_stop(engine, dt, along), _stop(engine, dt / 2, along))
    return float(np.linalg.norm(way - STOP * along))


def isotropy(engine: Engine, dt: float) -> float:
    """Error of scene 5, boxes that slide in nine directions, m.

    The error is the larger of two lengths: the longest minus the shortest stopping distance, and the largest distance from a straight path.
    """
    angles = np.radians([0, 10, 22.5, 30, 45, 60, 67.5, 80, 90])
    along = np.array([np.cos(angles), np.sin(angles)]).T
    end = _stop(engine, dt, along)
    forward, aside = (end * along).sum(axis=1), end[:, 0] * along[:, 1] - end[:, 1] * along[:, 0]
    return float(max(np.ptp(forward), np.abs(aside).max()))


MU_BALL = 0.3
RADIUS = 0.1
SLIP = 10 * 3.5 * MU_BALL * G * COARSEST
"""Initial speed v of the ball, m/s, with which it slips for the time 2 v / (7 mu g), ten of the largest time steps."""


def _roll(engine: Engine, dt: float) -> tuple[float, float]:
    """Speed (m/s) and travelled distance (m) of the ball of scene 6, which first slips and then rolls, after two seconds."""
    world = engine.start(document(FLOOR + free("body", ball(RADIUS, 0.7), (0, 0, RADIUS)), friction=MU_BALL), dt)
    world.step(SETTLE)
    start = world.qpos[0]
    world.set(start, [SLIP, 0, 0, 0, 0, 0])
    world.run(2.0)
    return float(world.qvel[0, 0]), float(world.qpos[0, 0] - start[0])


def slip_to_roll(engine: Engine, dt: float) -> float:
    """Error of scene 6, a ball that first slips and then rolls.

    The result is the error of the final speed (m/s) or of the extrapolated distance (m), the larger of the two.
    """
    (v, way), (_, half) = _roll(engine, dt), _roll(engine, dt / 2)
    slip_time, slip_way, rolling = 2 * SLIP / (7 * MU_BALL * G), 12 * SLIP**2 / (49 * MU_BALL * G), 5 * SLIP / 7
    right = slip_way + rolling * (2.0 - slip_time)
    return max(abs(v - rolling), abs(2 * half - way - right))


# Scene 32. The mass of the object is such that the friction limit mu N is 2 N.

LOAD = 2.0


def _tray(mu: float, factor: float, engine: Engine, dt: float) -> World:
    """Environment of scene 32: a body at rest on a tray, pushed by `factor` times the force at which it slides."""
    mass = LOAD / (mu * G)
    world = engine.start(document(FLOOR + free("body", box((0.1, 0.1, 0.02), mass), (0, 0, 0.02)), friction=mu), dt)
    world.step(SETTLE)
    world.push("body", (factor * LOAD * math.cos(0.3), factor * LOAD * math.sin(0.3), 0.0))
    return world


def tray_holds(engine: Engine, dt: float, mu: float) -> float:
    """Error of scene 32, a body on a tray: creep speed at 0.99 of the force at which it slides, m/s."""
    return creep(_tray(mu, 0.99, engine, dt), 2000)


def tray_slips(engine: Engine, dt: float, mu: float) -> float:
    """Error of scene 32, a body on a tray pushed with 1.01 of the force at which it slides.

    The error is the relative error of the acceleration (F - mu m g) / m.
    """
    world = _tray(mu, 1.01, engine, dt)
    world.step(20)
    before, steps = world.qvel[0, :3], 400
    world.step(steps)
    gained = float(np.linalg.norm(world.qvel[0, :3] - before)) / (steps * dt)
    return abs(gained / (0.01 * mu * G) - 1.0)


TEN_DEGREES = partial(sticking, slope=math.radians(10), mu=1.0, steps=10_000)
COULOMB = "statics with Coulomb's law"
TOLERANCE = "a solver residual of 1e-6 m/s, over a second of motion"
ACCELERATION = "1e-4 of the net force, which is at most 1 % of the friction force"

SCENES = (
    Scene(
        "3",
        "incline below the friction angle",
        "v = 0 in 1e5 steps",
        COULOMB,
        "m/s",
        flat(CREEP),
        NO_CREEP,
        partial(sticking, slope=CRITICAL - NEAR, mu=MU_INCLINE, steps=100_000),
        test_dts=(2e-3, 2e-2),
    ),
    Scene("3", "incline of 10 degrees, mu 1", "v = 0", COULOMB, "m/s", flat(CREEP), NO_CREEP, TEN_DEGREES),
    Scene("3", "penetration at rest on it", "none", "rigid bodies", "m", flat(1e-5), "0.01 mm", penetration_at_rest),
    Scene("3", "incline above the friction angle", "a = g (sin - mu cos)", COULOMB, "1", flat(1e-4), ACCELERATION, sliding),
    Scene("4", "stopping distance", "v0^2 / (2 mu g)", "work of Coulomb's friction", "m", flat(1e-6), TOLERANCE, stopping),
    Scene(
        "5",
        "isotropy of friction",
        "straight paths of equal length in nine directions",
        "the friction cone is circular",
        "m",
        flat(1e-6),
        TOLERANCE,
        isotropy,
    ),
    Scene(
        "6",
        "slip to roll",
        "5 v0 / 7 after 12 v0^2 / (49 mu g)",
        "Coulomb friction of a solid ball",
        "m/s, m",
        flat(1e-6),
        TOLERANCE,
        slip_to_roll,
    ),
    *(
        scene
        for mu in (1.0, 0.55)
        for scene in (
            Scene("32", f"tray, 2 N at 0.99 mu N, mu {mu}", "v = 0", COULOMB, "m/s", flat(CREEP), NO_CREEP, partial(tray_holds, mu=mu)),
            Scene(
                "32",
                f"tray, 2 N at 1.01 mu N, mu {mu}",
                "a = F/m - mu g",
                COULOMB,
                "1",
                flat(1e-4),
                ACCELERATION,
                partial(tray_slips, mu=mu),
            ),
        )
    ),
)
