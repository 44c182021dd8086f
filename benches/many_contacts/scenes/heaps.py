"""Scenes with heaps of boxes and of jacks, a wall of bricks, and balls on a plate."""

import functools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from atlas.mjcf import FLOOR, ball, box, document, free
from atlas.scenes.simbenchmark import FORCE, WAY, balls_on_plate
from numpy.typing import NDArray

from many_contacts.assets import Assets
from many_contacts.scene import Phase, Scene, Script, still, turned, uncontrolled

BIN = 0.22
"""Half the width of the bin, m."""
DENSITY = 500.0
"""Density of boxes and bricks, that of wood, kg/m^3."""
ROD = (0.06, 0.012)
"""Half length and half width of each of the three crossed rods of a jack, m."""
FALL, SETTLE, LIE = 600, 60, 100
"""Numbers of steps of 2 ms.

In the first steps the boxes or jacks fall. In the next ones they settle in each engine, and in the last ones they lie at rest.
"""
BRICK, JOINT = np.array([0.1, 0.05, 0.03]), 0.004
"""Half sizes of a brick, m, and gap between bricks of a course, m."""
COURSES, LENGTH = 5, 3
"""Number of courses of bricks, and of bricks per course."""
STRIKER = (0.06, 2.0, 3.0)
"""Radius (m), mass (kg) and speed (m/s) of the ball that hits the wall."""


def parsed(text: str, timestep: float) -> Any:
    """Model specification from MJCF text, with a time step in s."""
    s = mujoco.MjSpec.from_string(text)
    s.option.timestep = timestep
    return s


def wooden(half: NDArray[np.float64]) -> str:
    """MJCF attributes of a wooden box with these half sizes, m."""
    return box(half, float(DENSITY * 8 * half.prod()))


def in_bin(bodies: str) -> Any:
    """Model specification (`MjSpec`) of bodies (MJCF) above an open bin."""
    side = 'type="box" size="{} {} 0.1" pos="{} {} 0.1"'
    sides = [(0.01, BIN, s * BIN, 0) for s in (-1, 1)] + [(BIN, 0.01, 0, s * BIN) for s in (-1, 1)]
    walls = "".join(f'<geom name="side{i}" {side.format(*numbers)}/>' for i, numbers in enumerate(sides))
    return parsed(document(FLOOR + walls + bodies, friction=0.6), 0.002)


def bin_of_boxes(count: int, _: Assets) -> Any:
    """Model specification (`MjSpec`) of `count` boxes of 4 to 10 cm above an open bin."""
    halves = np.random.default_rng(count).uniform(0.02, 0.05, (count, 3))
    return in_bin("".join(free(f"box{i}", wooden(half), (0, 0, 1)) for i, half in enumerate(halves)))


def bin_of_jacks(count: int, _: Assets) -> Any:
    """Model specification (`MjSpec`) of `count` jacks above an open bin. A jack is a body of three crossed rods (box geoms)."""
    first, *others = (wooden(np.roll([ROD[0], ROD[1], ROD[1]], axis)) for axis in range(3))
    rods = "".join(f"<geom {rod}/>" for rod in others)
    return in_bin("".join(free(f"jack{i}", first, (0, 0, 1), inside=rods) for i in range(count)))


def pour(count: int, model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which `count` bodies fall into a bin.

    The bodies start in layers of four above the bin, with random orientations.
    """
    qpos = still(model.qpos0, num_envs).reshape(num_envs, count, 7)
    layer, place = np.divmod(np.arange(count), 4)
    corner = 0.1 * np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])[place]
    qpos[..., :2] = corner + rng.uniform(-0.01, 0.01, (num_envs, count, 2))
    qpos[..., 2] = 0.12 + 0.18 * layer
    qpos[..., 3:] = turned(rng, num_envs * count).reshape(num_envs, count, 4)
    return Script(qpos.reshape(num_envs, -1), uncontrolled(num_envs))


def wall_of_bricks(_: Assets) -> Any:
    """Model specification (`MjSpec`) of a brick wall and a ball.

    Courses are shifted by two fifths of a brick, so that the centre of each brick is supported.
    """
    mass = float(DENSITY * 8 * BRICK.prod())
    bricks = ""
    for course in range(COURSES):
        for k in range(LENGTH):
            x = (2 * BRICK[0] + JOINT) * (k - (LENGTH - 1) / 2 + (0.2 if course % 2 else -0.2))
            bricks += free(f"brick{course}{k}", box(BRICK, mass), (x, 0, BRICK[2] * (2 * course + 1)))
    striker = free("striker", ball(*STRIKER[:2]), (0, -1.0, 0.5))
    return parsed(document(FLOOR + bricks + striker, friction=0.6), 0.002)


def strike(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which a ball hits a brick wall at a random place."""
    before = PHASES_OF_WALL[0].steps * float(model.opt.timestep)
    qpos, qvel = still(model.qpos0, num_envs), np.zeros((num_envs, model.nv))
    speed, gravity = STRIKER[2], -float(model.opt.gravity[2])
    qpos[:, -7] = rng.uniform(-0.2, 0.2, num_envs)
    qpos[:, -6] = -BRICK[1] - STRIKER[0] - speed * before
    height = rng.uniform(0.12, 0.24, num_envs)
    qpos[:, -5], qvel[:, -4] = height + 0.02, gravity * before / 2 - 0.02 / before
    qvel[:, -5] = speed
    return Script(qpos, uncontrolled(num_envs), qvel=qvel)


PHASES_OF_WALL = (Phase("stands", 100), Phase("impact", 60))


def plate(_: Assets) -> Any:
    """Model specification (`MjSpec`) of SimBenchmark's plate with 25 balls."""
    return parsed(balls_on_plate(), 0.002)


def pulled(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) for the plate with balls.

    A constant force pulls the plate, and the initial speed is random.
    """
    push = np.zeros((model.nbody, 6))
    push[model.body("plate").id, :3] = FORCE * WAY
    qvel = np.zeros((num_envs, model.nv))
    qvel[:, 0] = rng.uniform(0.0, 0.5, num_envs)
    return Script(still(model.qpos0, num_envs), uncontrolled(num_envs), qvel=qvel, push=push)


def _heap(name: str, about: str, count: int, spec: Callable[[int, Assets], Any]) -> Scene:
    """Scene with `count` bodies in a bin, whose model `spec` makes."""
    return Scene(
        name,
        f"{about} that have fallen into a bin, friction 0.6, 2 ms",
        functools.partial(spec, count),
        functools.partial(pour, count),
        (Phase("settles", SETTLE, timed=False), Phase("lies", LIE)),
        lead=FALL,
        group="heaps",
    )


SCENES = (
    _heap("heap of ten", "ten boxes of 4 to 10 cm", 10, bin_of_boxes),
    _heap("heap of thirty", "thirty boxes of 4 to 10 cm", 30, bin_of_boxes),
    Scene(
        "wall",
        f"{COURSES} courses of {LENGTH} bricks in running bond, friction 0.6, 2 ms; then a ball of 2 kg hits it at 3 m/s",
        wall_of_bricks,
        strike,
        PHASES_OF_WALL,
    ),
    Scene(
        "balls on a plate",
        "SimBenchmark's 25 balls that roll on a plate, which a force of 150 N pulls over the floor, 2 ms",
        plate,
        pulled,
        (Phase("roll", 100),),
    ),
    _heap("heap of jacks", "ten jacks, bodies of three crossed rods of 12 cm,", 10, bin_of_jacks),
)
