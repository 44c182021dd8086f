"""Scene 41: a tall box tips over its edge iff the applied torque about the edge exceeds the torque of its weight."""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import TypeAlias

import numpy as np
from scipy.integrate import solve_ivp

from atlas.mjcf import FLOOR, G, box, document, free, incline
from atlas.scene import Engine, Scene
from atlas.world import World

Start: TypeAlias = Callable[[float, Engine, float], World]
WIDE, TALL, MASS = 0.1, 0.2, 2.0
"""Half width and half height, m, and mass, kg."""
BOX = box((WIDE, 0.15, TALL), MASS)
MU = 1.0
"""Friction coefficient: twice the ratio of the tipping force to the weight, so that the box tips before it could slide."""
ABOVE, BELOW = 1.001, 0.999
SECONDS = 2.0
ARM = math.hypot(WIDE, TALL)
INERTIA = MASS * ARM**2 * 4 / 3
"""Moment of inertia about a bottom edge, kg m^2."""
FORCE = MASS * G * WIDE / TALL
"""Horizontal force at the centre that tips the box, N."""
TILT = 0.1
"""Tilt at which the fall of a tipping box is compared with the exact solution, rad."""


def _pushed(factor: float, engine: Engine, dt: float) -> World:
    """Environment of scene 41 with a box that is pushed by `factor` times the force at which it tips."""
    world = engine.start(document(FLOOR + free("box", BOX, (0, 0, TALL)), friction=MU), dt)
    world.push("box", (factor * FORCE, 0, 0))
    return world


def _leaning(factor: float, engine: Engine, dt: float) -> World:
    """Environment of scene 41 with a box on a plane whose slope is `factor` times that at which it tips."""
    return engine.start(incline(BOX, TALL, math.atan(factor * WIDE / TALL), MU), dt)


def _tilt(world: World, upright: np.ndarray) -> float:
    """Angle between the current axis of the box and its initial axis, rad."""
    axis = world.at().xmat[1].reshape(3, 3)[:, 2]
    return math.atan2(float(np.linalg.norm(np.cross(axis, upright))), float(axis @ upright))


def _upright(world: World) -> np.ndarray:
    """Axis of the box that points up in the upright pose, (3,)."""
    return np.array(world.at().xmat[1].reshape(3, 3)[:, 2])


def stays(engine: Engine, dt: float, start: Start) -> float:
    """Error of scene 41, a box at 0.999 of the threshold at which it tips: its tilt in two seconds, rad.

    `start` makes the environment: `_pushed` or `_leaning`.
    """
    world = start(BELOW, engine, dt)
    upright = _upright(world)
    return world.worst(lambda: _tilt(world, upright), 20, SECONDS / 20)


@cache
def _fall(kind: str) -> float:
    """Exact time in which scene 41's box, with 1.001 of the load at which it tips, tilts by the angle `TILT`, s.

    The time comes from numerical integration of the rotation about the edge. `kind` is the kind of load: "pushed" or "leaning".
    """
    pull = ABOVE * FORCE if kind == "pushed" else MASS * G * math.sin(math.atan(ABOVE * WIDE / TALL))
    weight = MASS * G if kind == "pushed" else MASS * G * math.cos(math.atan(ABOVE * WIDE / TALL))
    corner = math.atan2(TALL, WIDE)

    def rate(_: float, y: np.ndarray) -> list[float]:
        # At the tilt phi, the centre is ARM cos(corner + phi) behind the edge, against the pull, and ARM sin(corner + phi) above it.
        angle = corner + y[0]
        return [y[1], ARM * (pull * math.sin(angle) - weight * math.cos(angle)) / INERTIA]

    def there(_: float, y: np.ndarray) -> float:
        return float(y[0]) - TILT

    there.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rate, (0.0, 10.0), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14, events=there)
    return float(found.t_events[0][0])


def tips(engine: Engine, dt: float, start: Start, kind: str) -> float:
    """Error of scene 41, a box at 1.001 of the threshold at which it tips: relative error of the tilt.

    The tilt is measured at the time at which the exact tilt is `TILT`.
    """
    world = start(ABOVE, engine, dt)
    upright = _upright(world)
    world.run(_fall(kind))
    # The simulation ends after a whole number of steps; the right tilt is extrapolated to that time with the rate of the fall.
    right = TILT * math.exp(RATE * (world.seconds - _fall(kind)))
    return abs(_tilt(world, upright) / right - 1.0)


RATE = math.sqrt(MASS * G * ARM**2 / TALL / INERTIA)
"""Exponential growth rate of the tilt phi under the critical force F, 1/s.

The tilt satisfies I phi'' = (F WIDE + m g TALL) phi, with the mass m and the moment of inertia I about the edge.
"""
HELD = "1e-6 rad: errors of the solver, 1e-6 m/s, cancel from step to step"
LATE = "exp(rate h) - 1 for a step early or late, with the growth rate of the tilt, plus 1e-3 for the solver's tolerance"

SCENES = tuple(
    scene
    for start, kind in ((_pushed, "pushed"), (_leaning, "leaning"))
    for scene in (
        Scene(
            "41",
            f"{kind} box at 0.999 of tipping",
            "stands for two seconds",
            "statics",
            "rad",
            lambda dt: 1e-6,
            HELD,
            partial(stays, start=start),
        ),
        Scene(
            "41",
            f"{kind} box at 1.001 of tipping",
            f"tilts by {TILT} rad in {_fall(kind):.3f} s",
            "I phi'' about its edge, DOP853, rtol 1e-12",
            "1",
            lambda dt: math.expm1(RATE * dt) + 1e-3,
            LATE,
            partial(tips, start=start, kind=kind),
        ),
    )
)
