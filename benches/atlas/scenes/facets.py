"""Scene 38: a ball glides over surfaces of triangles. The shape of the surface affects its motion, seams between triangles do not."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from atlas.mjcf import G, ball, document, free, surface
from atlas.scene import Engine, Scene, flat
from atlas.world import World

RADIUS, HALF = 0.1, 0.5
"""Radius of the ball, and half size of the square surface, m."""
CREST, BOWL = 0.5, 0.5
"""Curvature coefficients of the ground surfaces, 1/m: "crest" is z = -CREST y^2, and "bowl" contains BOWL (x^2 + y^2)."""
POINTS = 41
SPEED = 0.5
TENT, VALLEY = 0.1, 0.2
"""Slopes of both sides of the ground surface "tent", and of the far side of the "valley", rad."""

Heights = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


def _start(engine: Engine, dt: float, heights: Heights, at: tuple[float, float], kind: str) -> World:
    """Environment with a frictionless ball on a surface of triangles or a height field, 1 um above it."""
    line = np.linspace(-HALF, HALF, POINTS)
    x, y = np.meshgrid(line, line)
    z = heights(x, y)
    # Lowest height at (x, y) at which the ball does not overlap the exact surface.
    fine = np.linspace(-RADIUS, RADIUS, 401)
    dx, dy = np.meshgrid(fine, fine)
    under = dx**2 + dy**2 < RADIUS**2
    lift = heights(at[0] + dx, at[1] + dy) - z.min() + np.sqrt(np.maximum(RADIUS**2 - dx**2 - dy**2, 0.0))
    top = float(np.max(lift[under]))
    assets, geom = surface(HALF, z, kind)
    return engine.start(document(geom + free("ball", ball(RADIUS, 1.0), (*at, top + 1e-6)), friction=0.0, before=assets), dt)


def _share(world: World, velocity: tuple[float, float, float], seconds: float) -> float:
    """Energy that a moving ball keeps, as a fraction: 1 plus the change of its total energy divided by its initial kinetic energy."""
    world.set(qvel=[*velocity, 0, 0, 0])
    before = float(world.energy()[0])
    kinetic = float(world.kinetic()[0])
    world.run(seconds)
    return (float(world.energy()[0]) - before) / kinetic + 1.0


def crest(engine: Engine, dt: float, kind: str) -> float:
    """Error of scene 38 with a ball that glides along a straight crest, a row of edges, for 0.6 s: relative change of the energy.

    `kind` is the kind of surface: "hfield" or "mesh".
    """
    world = _start(engine, dt, lambda _x, y: -CREST * y**2, (-0.3, 0.0), kind)
    return abs(_share(world, (SPEED, 0.0, 0.0), 0.6) - 1.0)


def tent(engine: Engine, dt: float) -> float:
    """Relative change of the energy of a ball that glides over a convex edge. The ball is too slow to take off."""
    world = _start(engine, dt, lambda x, _y: -math.tan(TENT) * np.abs(x), (-0.1, 0.01), "hfield")
    return abs(_share(world, (SPEED * math.cos(TENT), 0.0, SPEED * math.sin(TENT)), 0.5) - 1.0)


def valley(engine: Engine, dt: float) -> float:
    """Error of scene 38 with a ball that glides over a concave edge between two planes.

    The ball may keep a fraction of its kinetic energy from cos^2(a) to 1, where a is the angle between the planes. The error is the
    distance of the simulated fraction from this range.
    """
    world = _start(engine, dt, lambda x, _y: math.tan(VALLEY) * np.maximum(x, 0.0), (-0.2, 0.01), "hfield")
    left = _share(world, (2 * SPEED, 0.0, 0.0), 0.3)
    return max(math.cos(VALLEY) ** 2 - left, left - 1.0, 0.0)


def bowl(engine: Engine, dt: float, kind: str) -> float:
    """Error of scene 38 with a ball that rolls from rest in a bowl of facets for 1 s.

    The error is the largest change of the ball's energy relative to the initial energy. `kind` is the kind of surface: "hfield" or "mesh".
    """
    sign = 1.0 if kind == "hfield" else -1.0
    world = _start(engine, dt, lambda x, y: BOWL * (x**2 + y**2 + sign * x * y), (0.25, 0.0), kind)
    # Initial height of the ball's centre above its rest position, which is RADIUS above the lowest point of the bowl.
    height = float(world.qpos[0, 2]) - RADIUS
    before = world.energy()[0]
    return world.worst(lambda: abs(world.energy()[0] - before) / (G * height), 10, 0.1)


CONSERVED = "without friction, only concave edges dissipate energy, a share of sin^2 of their angle"
TURNS = "at the edge the normal rotates by v dt / r per step; Euler's rule is off by the motion of a step, g v dt sin(a)"
LATE = "the contact is up to a step late: a height of v dt sin(a)"
FACETS = "each of 40 edges of 0.025 rad, back and forth, takes sin^2 of its angle, and contacts are up to a step late: g v dt sin(a)"


def _bowl(dt: float) -> float:
    """Tolerance of the relative change of energy of a ball that rolls for 1 s in a bowl of flat facets, at the time step `dt`, s.

    The ball crosses 40 edges between facets, and each edge dissipates a fraction of the energy. The energy also changes because the
    engine can detect a contact up to one step late.
    """
    return 3 * 40 * math.sin(0.025) ** 2 + 2 * dt


SCENES = (
    *(
        Scene(
            "38",
            f"crest, {name}",
            "constant energy",
            CONSERVED,
            "1",
            flat(1e-4),
            "rounding of the height in f32",
            partial(crest, kind=kind),
        )
        for kind, name in (("hfield", "height field"), ("mesh", "mesh"))
    ),
    Scene(
        "38",
        "tent: a convex edge",
        "constant energy",
        CONSERVED,
        "1",
        lambda dt: 1e-3 + 4 * TENT * SPEED * dt / RADIUS + 2 * G * dt * math.sin(TENT) / SPEED,
        TURNS,
        tent,
    ),
    Scene(
        "38",
        "valley: a concave edge",
        "a share of the energy between cos^2 of the angle and 1",
        CONSERVED,
        "1",
        lambda dt: 1e-3 + 2 * G * dt * math.sin(VALLEY) / (2 * SPEED),
        LATE,
        valley,
    ),
    *(
        Scene("38", f"bowl, {name}", "almost constant energy", CONSERVED, "1", _bowl, FACETS, partial(bowl, kind=kind))
        for kind, name in (("hfield", "height field"), ("mesh", "mesh"))
    ),
)
