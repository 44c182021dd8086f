"""Scenes 36, 37 and 39: constraints with unreachable position targets, or with large initial position errors."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import document
from atlas.scene import Engine, Scene, flat, unrest

# Scene 36: an equality pulls the tip of a two-link arm to a point beyond its reach; no gravity, no friction.

LINK, FAR = 0.5, 1.2


def out_of_reach() -> str:
    """MJCF of scene 36: a bent two-link arm whose tip is pulled to a point beyond its reach, at the height of its first joint."""
    second = (
        f'<body pos="{LINK} 0 0"><joint axis="0 1 0" damping=".1"/><geom type="capsule" size=".02" fromto="0 0 0 {LINK} 0 0" mass="1"/>'
    )
    second += f'<site name="tip" pos="{LINK} 0 0"/></body>'
    arm = f'<body name="arm"><joint axis="0 1 0" damping=".1"/><geom type="capsule" size=".02" fromto="0 0 0 {LINK} 0 0" mass="1"/>'
    arm += f"{second}</body>"
    target = f'<site name="target" pos="{FAR} 0 0"/>'
    text = document(target + arm, gravity=(0, 0, 0))
    equality = '<equality><connect site1="tip" site2="target"/></equality>'
    return text.replace("<geom ", '<geom contype="0" conaffinity="0" ').replace("</mujoco>", equality + "</mujoco>")


def gap_left(engine: Engine, dt: float) -> float:
    """Error of scene 36, an arm pulled to a point beyond its reach, after three seconds.

    If the arm is almost at rest, the error is the distance of its tip from the target minus the smallest possible distance, m. If the
    kinetic energy is above 1 mJ, the error is a speed, m/s: a point mass with the arm's mass has the same kinetic energy at this speed.
    """
    world = engine.start(out_of_reach(), dt)
    world.set(qpos=[0.6, -1.0])
    world.run(3.0)
    a, b = world.qpos[0]
    tip = LINK * np.array([math.cos(a) + math.cos(a + b), -math.sin(a) - math.sin(a + b)])
    energy = float(world.kinetic()[0])
    if energy > 1e-3:
        return math.sqrt(2 * energy / float(world.model.body_subtreemass[0]))
    return abs(float(np.linalg.norm(tip - [FAR, 0.0])) - (FAR - 2 * LINK))


# Scene 37: a pendulum whose hinge is inside a ball, and a slider in a slot that is too narrow for it.

ROD, ROD_MASS = 0.3, 0.5


def hinge_in_a_ball(joint: str) -> str:
    """MJCF of scene 37: a pendulum whose joint is inside a ball.

    The contact normal passes through the joint: no motion reduces the overlap.
    """
    rod = f'<geom type="capsule" size=".02" fromto="0 0 0 {ROD} 0 0" mass="{ROD_MASS}" condim="1"/>'
    return document(f'<geom size=".05" condim="1"/><body name="rod">{joint}{rod}</body>')


def pendulum_gain(engine: Engine, dt: float, joint: str) -> float:
    """Error of scene 37, a pendulum with its joint inside a ball: largest gain of energy in two seconds.

    The gain is relative to the potential energy of the rod. `joint` is the MJCF of the joint.
    """
    world = engine.start(hinge_in_a_ball(joint), dt)
    start = world.energy()[0]
    return world.worst(lambda: world.energy()[0] - start, 20, 0.1) / (ROD_MASS * 9.81 * ROD)


SLOT, TOO_WIDE, ASIDE = 0.1, 1e-3, 4e-4


def narrow_slot() -> str:
    """MJCF of scene 37: a box on a slide between two walls, which overlaps each wall by a millimetre in the middle."""
    walls = "".join(f'<geom type="box" size=".05 .1 .1" pos="{side * (SLOT + 0.05)} 0 0" condim="1"/>' for side in (1, -1))
    box = f'<geom type="box" size="{SLOT + TOO_WIDE} .05 .05" mass="1" condim="1"/>'
    return document(f'{walls}<body name="box"><joint type="slide" axis="1 0 0"/>{box}</body>', gravity=(0, 0, 0))


def off_the_middle(engine: Engine, dt: float) -> float:
    """Error of scene 37, a box in a slot that is too narrow: distance from the middle (m) or speed (m/s), the larger of the two.

    The box starts 0.4 mm off the middle, and the error is measured half a second later.
    """
    return unrest(engine, dt, narrow_slot(), [ASIDE], max(0.5, 50 * dt))


# Scene 39: a hinge that begins half a radian outside its range.

OUTSIDE = 0.5


def beyond_its_range() -> str:
    """MJCF of scene 39: a rod on a hinge without gravity, which starts half a radian above its range. The range ends at zero."""
    rod = '<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/>'
    return document(f'<body name="rod"><joint name="hinge" axis="0 1 0" limited="true" range="-60 0"/>{rod}</body>', gravity=(0, 0, 0))


HINGE = '<joint axis="0 1 0" damping=".01"/>'
BALL = '<joint type="ball" damping=".01"/>'
ENERGY = "the contact does no work, as its normal passes through the hinge"
GAIN = "0.2 % of the energy, the gain of a first-order integrator for a swinging pendulum at 2 ms"

SCENES = (
    Scene(
        "36",
        "a weld out of reach",
        "the arm comes to rest, stretched towards the target",
        "geometry: the nearest reachable point",
        "m, m/s",
        flat(1e-3),
        "0.1 % of the length of the arm",
        gap_left,
    ),
    *(
        Scene(
            "37",
            f"a {name} inside a ball",
            "damped motion without gain of energy",
            ENERGY,
            "1",
            lambda dt: max(2e-3, dt),
            GAIN,
            partial(pendulum_gain, joint=joint),
        )
        for name, joint in (("hinge", HINGE), ("ball joint", BALL))
    ),
    Scene(
        "37",
        "a slot too narrow for its box",
        "the box rests in the middle, where the overlaps are equal",
        "symmetry",
        "m, m/s",
        flat(1e-4),
        "10 % of the overlap",
        off_the_middle,
    ),
    Scene(
        "39",
        "half a radian outside a joint's range",
        "at rest at the end of the range after half a second",
        "a limit acts outside its range only",
        "rad, rad/s",
        flat(1e-2),
        "2 % of the error: corrections of a fifth per step leave 4e-3 of it after 22 steps of 20 ms",
        partial(unrest, mjcf=beyond_its_range(), qpos=[OUTSIDE], seconds=0.5),
    ),
)
