"""Scenes 29 and 30: rolling of Euler's disc, a coin, a wheel and a caster, and a rope around a capstan."""

import math

import numpy as np

from atlas.mjcf import FLOOR, G, document, free, numbers
from atlas.scene import Engine, Scene, flat
from atlas.scenes.friction import COULOMB, CREEP, NO_CREEP
from atlas.world import World

# Scene 29: a heavy disc, spun at a tilt, and a coin that rolls.

DISC_RADIUS, DISC_HALF, DISC_MASS = 0.0375, 0.0064, 0.44
DISC = f'type="cylinder" size="{DISC_RADIUS} {DISC_HALF}" mass="{DISC_MASS}"'


def _tilted(tilt: float) -> tuple[float, tuple[float, ...]]:
    """Height of the centre (m) and quaternion (w, x, y, z) of scene 29's disc with its lowest point on the floor.

    The disc's axis is tilted from the vertical about x by `tilt`, rad.
    """
    return DISC_RADIUS * math.sin(tilt) + DISC_HALF * math.cos(tilt), (math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0)


def _energy_growth(world: World, seconds: float) -> float:
    """Simulate `seconds`, and return the largest rise of the total energy above an earlier value, as a fraction of the initial energy."""
    least = start = float(world.energy()[0])
    worst = 0.0
    for _ in range(round(seconds / max(world.dt, 5e-3))):
        world.run(max(world.dt, 5e-3))
        now = float(world.energy()[0])
        worst, least = max(worst, now - least), min(least, now)
    return worst / start


def disc_energy_growth(engine: Engine, dt: float) -> float:
    """Growth of the energy of Euler's disc in three seconds, as a fraction of the initial energy.

    The disc starts at a tilt of 0.5 rad from the horizontal, in steady rolling with its centre at rest. A thin disc of radius r then turns
    about the vertical at the rate W, with W^2 = 4 g / (r sin(tilt)) (Moffatt 2000). The disc does not spin about its axis.
    """
    tilt = 0.5
    height, turn = _tilted(tilt)
    world = engine.start(document(FLOOR + free("disc", DISC, (0, 0, height), turn), friction=0.8), dt)
    rate = math.sqrt(4 * G / (DISC_RADIUS * math.sin(tilt)))
    # The angular velocity lies along the diameter through the contact: W sin tilt about the body's y axis.
    world.set(qvel=[0, 0, 0, 0, rate * math.sin(tilt), 0])
    return _energy_growth(world, 3.0)


def coin_energy_growth(engine: Engine, dt: float) -> float:
    """Growth of the energy of a coin that rolls for three seconds at 0.5 m/s, leaning by 0.1 rad, as a fraction of the initial energy."""
    height, turn = _tilted(math.pi / 2 - 0.1)
    world = engine.start(document(FLOOR + free("coin", DISC, (0, 0, height), turn), friction=0.8), dt)
    # The body's z axis is nearly world -y: rolling towards +x is a spin about +y, so its component along the axis is negative.
    world.set(qvel=[0.5, 0, 0, 0, 0, -0.5 / DISC_RADIUS])
    return _energy_growth(world, 3.0)


# Scene 30: a rolling wheel with a lateral force; a caster; a rope of beads around a bollard.

WHEEL, WIDE, MU = 0.1, 0.05, 0.4


def lateral(engine: Engine, dt: float) -> float:
    """Sideways creep speed of a wheel that rolls at 1 m/s under a sideways force of 0.9 mu m g at its hub, m/s."""
    turn = (math.cos(math.pi / 4), math.sin(math.pi / 4), 0, 0)
    wheel = f'type="cylinder" size="{WHEEL} {WIDE}" mass="2"'
    world = engine.start(document(FLOOR + free("wheel", wheel, (0, 0, WHEEL), turn), friction=MU), dt)
    # The body's z axis is world -y: rolling towards +x is a spin about +y.
    world.set(qvel=[1.0, 0, 0, 0, 0, -1.0 / WHEEL])
    world.push("wheel", (0, 0.9 * MU * 2 * G, 0))
    world.run(0.1)
    start = float(world.qpos[0, 1])
    world.run(1.0)
    return abs(float(world.qpos[0, 1]) - start)


TRAIL, SPEED, SWUNG = 0.1, 0.5, 1.0


def caster(engine: Engine, dt: float) -> float:
    """Largest error of tan(a/2) in one second, where a is the angle between a caster and the line along which its pivot moves.

    The wheel does not slip sideways, so it follows a tractrix at any speed: tan(a/2) = tan(a0/2) exp(-s/L) (Newton 1676). Here a0 is the
    initial angle, s the distance of the pivot from its start, and L the distance from the pivot to the wheel.
    """
    wheel = f'<body pos="{-TRAIL} 0 0"><joint type="hinge" axis="0 1 0"/><geom type="sphere" size=".05" mass=".5"/></body>'
    fork = (
        f'<body name="fork"><joint type="hinge" axis="0 0 1"/><inertial pos="0 0 0" mass=".1" diaginertia="1e-4 1e-4 1e-4"/>{wheel}</body>'
    )
    cart = '<geom type="box" size=".1 .1 .01" pos="0 0 .1" mass="1000" contype="0" conaffinity="0"/>'
    slides = '<joint type="slide" axis="1 0 0"/>'
    lift = '<joint type="slide" axis="0 0 1"/>'
    # The fork slides vertically on the cart, and a weight of 20 kg presses the wheel down.
    press = f'<body>{lift}<geom type="sphere" size=".01" pos="0 0 .2" mass="20" contype="0" conaffinity="0"/>{fork}</body>'
    world = engine.start(document(FLOOR + f'<body name="cart" pos="0 0 .05">{slides}{cart}{press}</body>', friction=1.0), dt)
    world.set([0, 0, SWUNG, 0], [SPEED, 0, -SPEED / TRAIL * math.sin(SWUNG), SPEED * math.cos(SWUNG) / 0.05])

    def error() -> float:
        q = world.qpos[0]
        return abs(math.tan(q[2] / 2) - math.tan(SWUNG / 2) * math.exp(-q[0] / TRAIL))

    return world.worst(error, 50, 0.02)


BOLLARD, BEADS, ROPE_MU, TURN = 0.2, 16, 0.3, math.pi
STEP_ANGLE = TURN / BEADS
BEAD, BEAD_MASS, HOLD = 0.002, 0.1, 1.0
"""Radius of a bead, m; mass of a bead, kg; holding force at the weakly pulled end of the rope, N.

The tension, the mass of a bead and the length of a link give a lateral frequency of 25 rad/s, low enough for the largest time step.
"""
SECONDS = 0.5


def gripping() -> float:
    """Largest ratio of the tensions at both ends at which the rope of scene 30 does not slip, for a light rope with `BEADS` corners.

    At each corner the rope turns by an angle d. The tensions T1 and T2 on both sides, with friction mu, satisfy
    (T1 + T2) sin(d/2) mu >= (T2 - T1) cos(d/2). For many corners the ratio of the ends tends to exp(mu phi), with phi the total angle.
    """
    t = ROPE_MU * math.tan(STEP_ANGLE / 2)
    return ((1 + t) / (1 - t)) ** BEADS


def rope() -> str:
    """MJCF of scene 30: a rope of beads on hinges, half around a bollard, with a straight link at each end."""
    reach = BOLLARD + BEAD
    places = [np.array([reach * math.cos(a), 0, reach * math.sin(a)]) for a in (STEP_ANGLE * (k + 0.5) for k in range(BEADS))]
    link = 2 * reach * math.sin(STEP_ANGLE / 2)
    first, last = places[0] - [0, 0, link], places[-1] - [0, 0, link]
    points = [first, *places, last]
    text = ""
    for k, point in enumerate(points):
        at = point - points[k - 1] if k else point
        joints = '<joint type="hinge" axis="0 1 0"/>' if k else '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        solid = "" if 0 < k <= BEADS else 'contype="0" conaffinity="0"'
        text += f'<body name="bead{k}" pos="{numbers(at)}">{joints}<geom type="sphere" size="{BEAD}" mass="{BEAD_MASS}" {solid}/>'
    bollard = f'<geom type="capsule" size="{BOLLARD}" fromto="0 -1 0 0 1 0"/>'
    return document(bollard + text + "</body>" * len(points), friction=ROPE_MU, gravity=(0, 0, 0))


def _pulled(engine: Engine, dt: float, factor: float) -> float:
    """Displacement of the strongly pulled end of scene 30's rope in half a second, m, in the direction of the pull."""
    world = engine.start(rope(), dt)
    world.push("bead0", (0, 0, -HOLD))
    world.push(f"bead{BEADS + 1}", (0, 0, -HOLD * gripping() * factor))
    last = world.body(f"bead{BEADS + 1}")
    # Friction acts at the surface of a bead, not at its hinge: links turn by a thousandth of a radian before the rope is taut.
    world.run(SECONDS)
    start = float(world.at().xpos[last][2])
    world.run(SECONDS)
    return start - float(world.at().xpos[last][2])


def capstan_holds(engine: Engine, dt: float) -> float:
    """Error of scene 30, a rope around a bollard: creep speed with 0.95 of the pull at which it slips, m/s."""
    return abs(_pulled(engine, dt, 0.95)) / SECONDS


def capstan_slips(engine: Engine, dt: float) -> float:
    """Error of scene 30, a rope around a bollard pulled with 1.05 of the force at which it slips: shortfall of its displacement, m.

    The shortfall is half the displacement that the excess force would cause, minus the simulated displacement; 0 if negative.
    """
    surplus = 0.05 * HOLD * gripping() / ((BEADS + 2) * BEAD_MASS)
    return max(0.0, 0.5 * surplus * SECONDS**2 / 2 - _pulled(engine, dt, 1.05))


THOUSANDTH = "0.1 % of the initial energy"

SCENES = (
    Scene("29", "Euler's disc", "no growth of the energy", "friction only dissipates", "1", flat(1e-3), THOUSANDTH, disc_energy_growth),
    Scene("29", "rolling coin", "no growth of the energy", "friction only dissipates", "1", flat(1e-3), THOUSANDTH, coin_energy_growth),
    Scene("30", "wheel, 0.9 mu N sideways", "no lateral slip", COULOMB, "m/s", flat(CREEP), NO_CREEP, lateral),
    Scene(
        "30",
        "caster",
        "a tractrix",
        "no lateral slip, Newton 1676",
        "1",
        lambda dt: SPEED * dt / TRAIL / 2,
        "half the motion of a step relative to the trail: a first-order error",
        caster,
    ),
    Scene("30", "capstan at 0.95 of mu phi", "holds", "capstan equation for 16 corners", "m/s", flat(CREEP), NO_CREEP, capstan_holds),
    Scene(
        "30",
        "capstan at 1.05 of mu phi",
        "slips",
        "capstan equation for 16 corners",
        "m",
        flat(0.0),
        "at least half the displacement that the excess force causes",
        capstan_slips,
    ),
)
