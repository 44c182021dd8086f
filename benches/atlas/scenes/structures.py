"""Scene 16: structures: a house of cards, an arch of 17 blocks, a row of 15 dominoes."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import FLOOR, about_y, box, document, free, numbers
from atlas.scene import Engine, Scene, flat
from atlas.scenes.stacks import STATICS, moved

# Cards of 2 mm x 40 cm x 30 cm lean against each other at 25 degrees, mu 0.7: two frames, a card across their tops, and a third frame.

THIN, TALL, DEEP, LEAN, CARD = 0.001, 0.2, 0.15, math.radians(25), 0.17
RISE = TALL * math.cos(LEAN) + THIN * math.sin(LEAN)
"""Vertical distance from the centre of a leaning card to its lowest and to its highest edge, m."""
REACH = TALL * math.sin(LEAN) + THIN * math.cos(LEAN)
"""Horizontal distance from the centre of a leaning card to the edge where two cards of a frame meet, m.

The edge where they meet is 2 THIN sin(LEAN) below the card's highest edge.
"""
SPACING = 0.35


def _frame(name: str, x: float, z: float) -> str:
    """MJCF of a frame: two cards that lean against each other, with the middle at `x` and the feet at the height `z`, m.

    Each card requires the friction tan LEAN = 0.47 at its foot.
    """
    card = box((THIN, DEEP, TALL), CARD)
    cards = (free(f"{name}{side}", card, (x + side * REACH, 0, z + RISE), about_y(-side * LEAN)) for side in (-1, 1))
    return "".join(cards)


def house() -> str:
    """MJCF of a house of cards: two frames of two leaning cards, a card across their tops, and a third frame on that card."""
    across = free("across", box((TALL, DEEP, THIN), CARD), (0, 0, 2 * RISE + THIN))
    frames = _frame("left", -SPACING / 2, 0) + _frame("right", SPACING / 2, 0) + _frame("top", 0, 2 * RISE + 2 * THIN)
    return document(FLOOR + frames + across, friction=0.7)


# Arch of uniform thickness along a catenary, so that the thrust follows its centre line (Hooke 1675). Joints are normal to the thrust.

BLOCKS, SPREAD, THICK, ARCH_DEEP = 17, 1.6, 0.12, 0.15


def _catenary(s: float) -> tuple[np.ndarray, np.ndarray]:
    """Point (x, z) of the centre line and its normal, at arc length s from the crown: x = asinh(s), z = -cosh(x)."""
    x = math.asinh(s)
    slope = -math.sinh(x)
    normal = np.array([-slope, 1.0]) / math.hypot(slope, 1.0)
    return np.array([x, -math.cosh(x)]), normal


def arch() -> str:
    """MJCF of an arch of blocks of equal arc length, which stands on the floor.

    The first and the last block have horizontal faces on the floor. These faces need a friction of 0.42, and have 0.6.
    """
    ends = math.sinh(SPREAD)
    ground = -math.cosh(SPREAD)
    assets, bodies = "", ""
    for k in range(BLOCKS):
        corners = []
        for s in (ends * (2 * k / BLOCKS - 1), ends * (2 * (k + 1) / BLOCKS - 1)):
            centre, normal = _catenary(s)
            for side in (-1, 1):
                at = centre + side * THICK / 2 * normal
                if k in {0, BLOCKS - 1} and abs(abs(s) - ends) < 1e-9:
                    # Move the corner along the tangent of the arch to the height of the ground.
                    tangent = np.array([normal[1], -normal[0]])
                    at = at + tangent * (ground - at[1]) / tangent[1]
                corners.append(at - [0, ground])
        middle = np.mean(corners, axis=0)
        points = [(x - middle[0], y, z - middle[1]) for x, z in corners for y in (-ARCH_DEEP, ARCH_DEEP)]
        assets += f'<mesh name="block{k}" vertex="{numbers(c for p in points for c in p)}"/>'
        shape = f'<geom type="mesh" mesh="block{k}" density="1000"/>'
        bodies += f'<body name="block{k}" pos="{numbers((middle[0], 0, middle[1]))}"><freejoint/>{shape}</body>'
    return document(FLOOR + bodies, friction=0.6, before=f"<asset>{assets}</asset>")


# Dominoes of 1 x 5 x 10 cm, 5 cm apart, mu 0.6; the first one starts tilted past its balance point.

DOMINOES, GAP = 15, 0.05
DOMINO = (0.005, 0.025, 0.05)


def dominoes(engine: Engine, dt: float) -> float:
    """Error of the row of dominoes in scene 16: number of dominoes that do not fall within four seconds, or fall before their predecessor.

    A domino counts as fallen when its tilt exceeds 45 degrees.
    """
    row = "".join(free(f"domino{k}", box(DOMINO, 0.05), (GAP * k, 0, DOMINO[2])) for k in range(DOMINOES))
    world = engine.start(document(FLOOR + row, friction=0.6), dt)
    qpos = world.qpos[0].reshape(DOMINOES, 7)
    # Rotate the first domino about its lower front edge, by twice the angle at which its centre is above that edge.
    tip = 2 * math.atan(DOMINO[0] / DOMINO[2])
    x, _, z = DOMINO
    qpos[0, 0] = x - x * math.cos(tip) + z * math.sin(tip)
    qpos[0, 2] = x * math.sin(tip) + z * math.cos(tip)
    qpos[0, 3:] = about_y(tip)
    world.set(qpos.ravel(), np.zeros(6 * DOMINOES))
    fallen = np.full(DOMINOES, math.inf)
    for _ in range(round(4.0 / max(dt, 2e-3))):
        world.run(max(dt, 2e-3))
        quat = world.qpos[0].reshape(DOMINOES, 7)[:, 3:]
        upright = 1 - 2 * (quat[:, 1] ** 2 + quat[:, 2] ** 2)
        fallen = np.where((upright < math.cos(math.pi / 4)) & ~np.isfinite(fallen), world.seconds, fallen)
    in_order = np.isfinite(fallen) & (fallen >= np.concatenate([[0.0], fallen[:-1]]))
    return float(DOMINOES - in_order.sum())


LEVER = "a penetration of 1e-5 m at an edge moves the far end of a thin card by ten times as much"
FEW = (1e-3, 2e-3, 5e-3, 2e-2)

SCENES = (
    Scene("16", "house of cards", "stands", STATICS, "m", flat(1e-4), LEVER, partial(moved, mjcf=house(), seconds=5.0), FEW, (2e-3, 2e-2)),
    Scene(
        "16",
        "arch of 17 blocks",
        "stands",
        "catenary, Hooke 1675",
        "m",
        flat(1e-4),
        "ten joints of 1e-5 m",
        partial(moved, mjcf=arch(), seconds=5.0),
        FEW,
        (2e-3, 2e-2),
    ),
    Scene(
        "16",
        "15 dominoes",
        "fall in order",
        "each domino releases more energy than the next needs to tip",
        "1",
        flat(0.0),
        "all must fall",
        dominoes,
        FEW,
        (2e-3, 2e-2),
    ),
)
