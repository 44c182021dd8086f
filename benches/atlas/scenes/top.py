"""Scene 40: heavy symmetric top with a fixed point. Landau & Lifshitz, Mechanics, section 35; Goldstein, section 5.7."""

import math
from functools import partial

import numpy as np

from atlas.mjcf import G, about_y, document
from atlas.scene import Engine, Scene
from atlas.scenes.flight import second_order
from atlas.world import Array, World

MASS, ARM = 0.5, 0.05
TRANSVERSE, AXIAL = 5e-4, 1e-3
"""Moments of inertia about the centre of mass, kg m^2."""
ABOUT_POINT = np.array([TRANSVERSE + MASS * ARM**2, TRANSVERSE + MASS * ARM**2, AXIAL])
SPIN, TILT = 60.0, 0.6
"""Angular velocity along the axis (rad/s), angle between the axis and the vertical (rad)."""
WEIGHT = MASS * G * ARM
"""Torque of the weight about the fixed point if the axis is horizontal, m g l, N m."""
SECONDS = 5.0

TOP = document(f"""<body name="top"><joint type="ball"/>
  <inertial pos="0 0 {ARM}" mass="{MASS}" diaginertia="{TRANSVERSE} {TRANSVERSE} {AXIAL}"/>
  <geom type="cylinder" size=".05 .01" pos="0 0 {ARM}" mass="0" contype="0" conaffinity="0"/></body>""")  # fmt: skip


def precession() -> float:
    """Rate W of slow steady precession of the heavy top of scene 40, rad/s: I1 cos(tilt) W^2 - I3 spin W + m g l = 0.

    I1 and I3 are the transverse and axial moments of inertia about the fixed point. The centre of mass is at the distance l from it.
    """
    a, b = ABOUT_POINT[0] * math.cos(TILT), ABOUT_POINT[2] * SPIN
    return 2 * WEIGHT / (b + math.sqrt(b**2 - 4 * a * WEIGHT))


def _axes(world: World) -> Array:
    """Axes of the heavy top of scene 40 in world axes, columns of a matrix (3, 3)."""
    return np.asarray(world.at().xmat[1].reshape(3, 3))


def steady(engine: Engine, dt: float) -> float:
    """Error of scene 40, a heavy top: largest angle between its axis and the exact axis in steady precession, rad.

    The angle is sampled a hundred times in five seconds.
    """
    rate, world = precession(), engine.start(TOP, dt)
    world.set(about_y(TILT), [-rate * math.sin(TILT), 0.0, SPIN])

    def angle() -> float:
        turn, axis = rate * world.seconds, _axes(world)[:, 2]
        right = [math.sin(TILT) * math.cos(turn), math.sin(TILT) * math.sin(turn), math.cos(TILT)]
        return math.atan2(float(np.linalg.norm(np.cross(axis, right))), float(axis @ right))

    return world.worst(angle, 100, SECONDS / 100)


def nutation(engine: Engine, dt: float, of: str) -> float:
    """Error of scene 40, a nutating top: largest deviation in five seconds of its "energy", or of its constant "momenta".

    The energy is relative to `WEIGHT`. The momenta are the angular momenta about the vertical and about the axis, relative to the latter.
    """
    world = engine.start(TOP, dt)
    world.set(about_y(TILT), [0.0, 0.0, SPIN])
    about_axis = ABOUT_POINT[2] * SPIN
    first = AXIAL * SPIN**2 / 2 + WEIGHT * math.cos(TILT)

    def deviation() -> float:
        axes, omega = _axes(world), world.qvel[0]
        spin = ABOUT_POINT * omega
        if of == "energy":
            return abs(float(spin @ omega) / 2 + WEIGHT * float(axes[2, 2]) - first) / WEIGHT
        return max(abs(float(axes[2] @ spin) / about_axis - math.cos(TILT)), abs(float(spin[2]) / about_axis - 1.0))

    return world.worst(deviation, 250, SECONDS / 250)


NUTATION = AXIAL * SPIN / ABOUT_POINT[0]
"""Angular rate at which the axis nutates, I3 spin / I1, rad/s. Tolerances ignore the faster spin, which does not move the axis."""
BECAUSE = "(rate h)^2 of the nutation: a second-order integrator"

SCENES = (
    Scene(
        "40",
        "heavy top: steady precession",
        f"{precession():.3f} rad/s at a tilt of {TILT} rad, for five seconds",
        "Goldstein, section 5.7",
        "rad",
        second_order(NUTATION),
        BECAUSE,
        steady,
    ),
    Scene(
        "40",
        "heavy top: energy",
        "constant while it nutates",
        "conservation laws",
        "1",
        second_order(NUTATION),
        BECAUSE,
        partial(nutation, of="energy"),
    ),
    Scene(
        "40",
        "heavy top: angular momenta",
        "about the vertical and about the axis: constant while it nutates",
        "Landau & Lifshitz, section 35",
        "1",
        second_order(NUTATION),
        BECAUSE,
        partial(nutation, of="momenta"),
    ),
)
