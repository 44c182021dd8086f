"""Scenes 13 and 22 to 24: a ball on a chain, stiff servos, loops, joint limits."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, G, document
from atlas.scene import Engine, Scene, flat
from atlas.scenes.flight import second_order
from atlas.scenes.stacks import SHARE, STATICS, share
from atlas.world import Array, World

# Scene 13: 40 links of 5 cm and 20 g, and a ball 670 times heavier.

LINKS, LINK, LINK_MASS = 40, 0.05, 0.02
BALL_MASS = 670 * LINK_MASS
GHOST = 'contype="0" conaffinity="0"'
ROD = f'<geom type="capsule" size=".005" fromto="0 0 0 0 0 {-LINK}" mass="{LINK_MASS}" {GHOST}/>'
WEIGHT = f'<geom type="sphere" size=".1" pos="0 0 {-LINK}" mass="{BALL_MASS}" {GHOST}/>'
CARRIER = 1.0


def hung_from_a_carrier() -> str:
    """MJCF of scene 13: a chain with a heavy ball hangs by hinges from a plate of 1 kg on four feet.

    The contact force under the plate shows the tension.
    """
    text = ""
    for k in range(LINKS):
        axis = "0 1 0" if k % 2 == 0 else "1 0 0"
        text += f'<body pos="0 0 {-LINK if k else 0}"><joint type="hinge" axis="{axis}"/>{ROD}{WEIGHT if k == LINKS - 1 else ""}'
    feet = "".join(f'<geom type="sphere" size=".02" mass="{CARRIER / 4}" pos="{x} {y} 0"/>' for x in (-0.1, 0.1) for y in (-0.1, 0.1))
    return document(FLOOR + f'<body name="carrier" pos="0 0 .02"><freejoint/>{feet}{text}' + "</body>" * (LINKS + 1))


def tension(engine: Engine, dt: float) -> float:
    """Error of scene 13, a ball on a chain: relative error of the contact force under the plate that carries it, after two seconds."""
    world = engine.start(hung_from_a_carrier(), dt)
    world.run(2.0)
    return abs(world.normal_force() / ((CARRIER + LINKS * LINK_MASS + BALL_MASS) * G) - 1.0)


def of_loose_links() -> str:
    """MJCF of scene 13 with a chain of free bodies. An equality constraint connects each body to the body above."""
    text, joints = "", ""
    for k in range(LINKS):
        text += f'<body name="link{k}" pos="0 0 {-LINK * k}"><freejoint/>{ROD}{WEIGHT if k == LINKS - 1 else ""}</body>'
        above = f' body2="link{k - 1}"' if k else ""
        joints += f'<connect body1="link{k}"{above} anchor="0 0 0"/>'
    return document(text, after=f"<equality>{joints}</equality>")


def stretch(engine: Engine, dt: float) -> float:
    """Error of scene 13, a ball on a chain of loose links: displacement of the ball after two seconds, m."""
    world = engine.start(of_loose_links(), dt)
    start = world.qpos[0, -7:-4]
    world.run(2.0)
    return float(np.linalg.norm(world.qpos[0, -7:-4] - start))


# Scene 22: a critically damped servo on a mass m of 1 kg. Its stiffness k follows from a given value of h sqrt(k/m), with the time step h.

HELD = 200
"""Number of steps for which scene 22 runs."""


def servo(engine: Engine, dt: float, ratio: float) -> float:
    """Error of scene 22, a critically damped servo on a mass m = 1 kg: fraction of an initial offset that is left after 200 steps.

    The stiffness k of the servo follows from h sqrt(k/m) = ratio, where h is the time step.
    """
    k = (ratio / dt) ** 2
    slide = f'<body><joint name="slide" type="slide" axis="1 0 0"/><geom type="sphere" size=".1" mass="1" {GHOST}/></body>'
    drive = f'<actuator><position joint="slide" kp="{k!r}" kv="{2 * math.sqrt(k)!r}"/></actuator>'
    world = engine.start(document(slide, gravity=(0, 0, 0), after=drive), dt)
    world.step(HELD, [0.1])
    return abs(float(world.qpos[0, 0]) / 0.1 - 1.0)


# Scene 23: loops. A parallelogram passes through the position in which all links are in line; a ring of eight links swings.

CRANK, BASE, SPIN = 0.5, 1.0, 2.0


def four_bar() -> str:
    """MJCF of scene 23: a parallelogram of cranks of 0.5 m on pivots 1 m apart and a coupler of 1 m, without gravity."""
    rod = '<geom type="capsule" size=".02" fromto="0 0 0 {} 0 0" mass="{}" ' + GHOST + "/>"
    hinge = '<joint type="hinge" axis="0 -1 0"/>'
    coupler = f'<body name="coupler" pos="{CRANK} 0 0">{hinge}{rod.format(BASE, 1.0)}</body>'
    crank = f'<body name="crank">{hinge}{rod.format(CRANK, 0.5)}{coupler}</body>'
    rocker = f'<body name="rocker" pos="{BASE} 0 0">{hinge}{rod.format(CRANK, 0.5)}</body>'
    loop = f'<equality><connect body1="coupler" body2="rocker" anchor="{BASE} 0 0"/></equality>'
    return document(crank + rocker, gravity=(0, 0, 0), after=loop)


def turning(engine: Engine, dt: float, of: str) -> float:
    """Error of scene 23, a turning parallelogram, in ten seconds: largest "gap" of the loop (m), or relative error of the "energy".

    The parallelogram passes six times through the singularity in which all links are in line.
    """
    world = engine.start(four_bar(), dt)
    # All angles are zero when the links are in line; the loop is closed at any common angle of the cranks.
    world.set([1.0, -1.0, 1.0], [-SPIN, SPIN, -SPIN])
    start = float(world.energy()[0])

    def gap() -> float:
        return float(np.linalg.norm(_end(world, "coupler", BASE) - _end(world, "rocker", CRANK)))

    return world.worst(gap if of == "gap" else lambda: abs(world.energy()[0] / start - 1.0), 500, 0.02)


def _end(world: World, link: str, length: float) -> Array:
    """Position of the far end of a link of a length, (3,) m."""
    d, body = world.at(), world.body(link)
    return np.asarray(d.xpos[body] + length * d.xmat[body].reshape(3, 3)[:, 0])


RING = 8


def ring() -> str:
    """MJCF of scene 23: a ring of links of 0.2 m, a regular octagon in a vertical plane.

    An equality constraint closes the ring at its fixed corner.
    """
    turn, length = 2 * math.pi / RING, 0.2
    text = ""
    for k in range(RING):
        at = f"{length} 0 0" if k else "0 0 0"
        angle = turn if k else turn / 2
        text += f'<body name="link{k}" pos="{at}" euler="0 {angle!r} 0"><joint type="hinge" axis="0 1 0"/>'
        text += f'<geom type="capsule" size=".01" fromto="0 0 0 {length} 0 0" mass=".1" {GHOST}/>'
    loop = f'<equality><connect body1="link{RING - 1}" anchor="{length} 0 0"/></equality>'
    return document(text + "</body>" * RING, after=loop)


def ring_gap(engine: Engine, dt: float) -> float:
    """Error of scene 23, a hanging ring of links: largest gap in five seconds of swinging, m."""
    world = engine.start(ring(), dt)
    return world.worst(lambda: float(np.linalg.norm(_end(world, f"link{RING - 1}", 0.2))), 100, 0.05)


# Scene 24: a chain swings against its joint limits, which are its only dissipation.

LIMIT, LIMITED = 0.3, 5


def limited() -> str:
    """MJCF of scene 24: a chain of five links of 0.3 m with limits of 0.3 rad, except at the first joint."""
    text = ""
    for k in range(LIMITED):
        limits = f'range="{-LIMIT} {LIMIT}" limited="true"' if k else ""
        text += f'<body pos="0 0 {-0.3 if k else 0}"><joint type="hinge" axis="0 1 0" {limits}/>'
        text += f'<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".2" {GHOST}/>'
    return document(text + "</body>" * LIMITED)


RATE = math.sqrt(G / 0.3) * LIMITED
"""Estimate of the fastest motion of scene 24, rad/s: five times the frequency of a pendulum of one link."""


def gain(engine: Engine, dt: float) -> float:
    """Error of scene 24, a chain with joint limits: largest gain of energy in 1e4 steps.

    The gain is relative to the work of lifting the chain by its length.
    """
    world = engine.start(limited(), dt)
    world.set([1.5, 0.2, -0.2, 0.2, -0.2], np.zeros(LIMITED))
    start = world.energy()[0]
    return world.worst(lambda: world.energy()[0] - start, 1000, 10 * dt) / (0.2 * LIMITED * G * 0.3 * LIMITED)


CONSERVED = "conservation laws"
GAP = "0.01 mm, as for contacts"
LEFT = "0.1 %; the exact solution leaves e^-100 after 200 steps at a ratio of 0.5"

SCENES = (
    Scene("13", "ball and chain: tension", "the weight below", STATICS, "1", share, SHARE, tension),
    Scene(
        "13",
        "ball and chain of loose links",
        "no stretch",
        "rigid bodies",
        "m",
        flat(LINKS * 1e-5),
        "1e-5 m per link, as for contacts",
        stretch,
        (5e-4, 2e-3, 1e-2),
        (2e-3,),
    ),
    *(
        Scene(
            "22",
            f"servo, h sqrt(k/m) = {r}",
            "settles",
            "critically damped oscillator",
            "1",
            flat(1e-3),
            LEFT,
            partial(servo, ratio=r),
            (1e-4, 2e-3, 2e-2),
        )
        for r in (0.5, 2, 10, 100)
    ),
    Scene(
        "23",
        "four-bar through its singularity: gap",
        "the loop stays closed",
        "rigid links",
        "m",
        flat(1e-5),
        GAP,
        partial(turning, of="gap"),
    ),
    Scene(
        "23",
        "four-bar through its singularity: energy",
        "constant",
        CONSERVED,
        "1",
        second_order(SPIN),
        "(spin h)^2: a second-order integrator",
        partial(turning, of="energy"),
    ),
    Scene("23", "ring of eight links: gap", "the loop stays closed", "rigid links", "m", flat(1e-5), GAP, ring_gap),
    Scene(
        "24",
        "chain at its joint limits",
        "no energy gain in 1e4 steps",
        "inelastic limits",
        "1",
        second_order(RATE),
        "(rate h)^2: a second-order integrator",
        gain,
    ),
)
