"""Known failures of stepper in the scenes of the atlas. The page shows their reasons, and the tests check their bounds."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from atlas.mjcf import G
from atlas.scenes.mechanisms import HELD, RING


@dataclass(frozen=True)
class Bound:
    """Known error of stepper that is above the tolerance of its scene, and stays below a bound.

    Attributes:
        largest: Function from the time step, s, to the bound, in the unit of the scene.
        because: Origin of the bound, as text, such as a measurement.
    """

    largest: Callable[[float], float]
    because: str


@dataclass(frozen=True)
class Slope:
    """Known error of stepper that is proportional to a power of the time step.

    Attributes:
        power: Exponent of the time step: the order of the integrator, or twice the order in scenes with squared errors.
        dts: Time steps over which the exponent is measured, s.
        margin: Largest difference between the measured exponent and `power`.
        because: Origin of the margin, as text, such as a measurement.
    """

    power: float
    dts: tuple[float, ...]
    margin: float
    because: str


@dataclass(frozen=True)
class Divergence:
    """Known failure of stepper in which the simulation diverges until its numbers overflow.

    stepper must report the overflow by a status flag.
    """


@dataclass(frozen=True)
class Known:
    """Known failures of stepper in scenes of the atlas, with a common reason.

    Attributes:
        scenes: Regular expression for the number and name of the scenes, separated by a space.
        engines: Regular expression for the name of stepper with its settings in the table of engines.
        dts: Smallest and largest time step, s.
        reason: Reason of the failures.
        size: Size of the error that the tests check: a bound, a power of the time step, or an overflow. None if no test runs the scene.
    """

    scenes: str
    engines: str
    dts: tuple[float, float]
    reason: str
    size: Bound | Slope | Divergence | None = None


def below(largest: float, because: str) -> Bound:
    """Bound of a known error, with the same value at all time steps."""
    return Bound(lambda _dt: largest, because)


ANY = (0.0, 1.0)
EULER = r"stepper euler.*"
NOT_EULER = r"stepper(?! euler).*"
FIRST_ORDER = r"stepper (euler.*|implicit)"
COARSE = r"stepper(?! fine| f32).*"
"""Settings with the default tolerance of the solver, in f64."""

BAUMGARTE = r"stepper (euler, )?baumgarte"
RULE = "rules of the first order"
EXPLICIT = "springs and servos are explicit with this integrator, as in MuJoCo's: stable up to h sqrt(k/m) = 2"
HEAP = "a heap of 216 spheres falls by more than a radius in a few steps, and the contact law does not determine its motion"
MEASURED = "about twice the largest error measured"
TOLERANCE = "the solver stops at its default tolerance of 1e-4 m/s; `stepper fine` holds"

BAUMGARTE_SPEED = 1.0
"""Largest speed at which Baumgarte's method removes one position error, m/s or rad/s."""
PYRAMID_ROWS = sum(boxes * (row * BAUMGARTE_SPEED) ** 2 / 2 for row, boxes in enumerate((4, 3, 2, 1), start=1))
"""Kinetic energy of the pyramid of scene 17 if each row of boxes of 1 kg rises from the row below at `BAUMGARTE_SPEED`, J."""
BOUNCE = 49 * 10.0 * G * math.sqrt(2 * G * 5.0)
"""Energy error of scene S2 per second of delay of a bounce, W: the weight of the 49 spheres times their speed at the impact."""

KNOWN: tuple[Known, ...] = (
    Known(
        r"[12] .*",
        NOT_EULER,
        (2e-2, 1.0),
        "the textbook's recursion bounces at the end of the step; the midpoint rule bounces where the block meets the floor, and gravity "
        "acts on the rest of the step",
    ),
    Known(r"(8|10|11) .*", FIRST_ORDER, ANY, RULE),
    Known(
        r"40 .*",
        FIRST_ORDER,
        ANY,
        RULE,
        Slope(1.0, (2e-4, 1e-4, 5e-5), 0.1, "errors reach 0.1 of the motion in the largest of these steps; higher orders add as much"),
    ),
    Known(
        r"36 .*",
        BAUMGARTE,
        ANY,
        "the velocity that Baumgarte's method adds stays in the motion, and where position targets contradict one another it never ends",
        below(100.0, "the engine bounds the velocity change by Baumgarte's bias at 200 rad/s, and links are 0.5 m long"),
    ),
    Known(
        r"39 .*",
        BAUMGARTE,
        ANY,
        "the velocity that Baumgarte's method adds stays in the motion",
        below(BAUMGARTE_SPEED * (1 + 1e-6), "the largest speed of a correction, which nothing slows; the solver's tolerance"),
    ),
    Known(r"37 a slot .*", BAUMGARTE, (0.0, 2e-4), "position targets that contradict one another: impulses of 1e10 N s hold the box"),
    Known(r"40 .*", "stepper f32", (0.0, 1e-4), "the rounding of 50,000 steps in single precision"),
    Known(
        r"41 pushed box at 0.999 .*",
        "stepper f32",
        (3e-4, 3e-3),
        "single precision leaves velocities to 1e-5 m/s, and the box some 1e-6 rad",
    ),
    Known(
        r"41 .* 1.001 .*",
        "stepper f32",
        (0.0, 2e-4),
        "the rounding of 10,000 steps in single precision, compared with a thousandth of the weight",
    ),
    Known(
        r"9 .*",
        EULER,
        (6e-4, 1.0),
        "Euler's rule evaluates Coriolis and centrifugal forces at the beginning of the step, and gains energy",
        Divergence(),
    ),
    Known(
        r"13 .*tension",
        r"stepper.*",
        (5e-3, 1.0),
        "the chain continues to swing along its length at this time step; the mean tension is right",
        below(1.0 + 1e-3, "the tension swings between nothing and twice its mean; scene 13's tolerance for the mean"),
    ),
    Known(
        r"16 arch of 17 blocks",
        "stepper newton",
        (0.0, 1e-3),
        "Newton's method alone leaves one step unsolved (status has NOT_CONVERGED), and its residual lets blocks slip",
    ),
    Known(
        r"17 .*",
        BAUMGARTE,
        ANY,
        "Baumgarte's velocity stays in the motion as kinetic energy",
        below(
            PYRAMID_ROWS / (10 * G * 0.05) * (1 + 1e-3),
            "each row leaves the row below at the largest speed of a correction; a thousandth for gravity's work in the first step",
        ),
    ),
    Known(r"29 Euler.*", BAUMGARTE, ANY, "Baumgarte's velocity stays in the motion as kinetic energy", below(0.35, MEASURED)),
    Known(
        r"22 .* = 2",
        EULER,
        ANY,
        EXPLICIT,
        below((3.0 + math.sqrt(12.0)) ** HELD, "largest eigenvalue of the explicit rule with these gains, to the power of the steps"),
    ),
    Known(r"22 .* = (10|100)", r"stepper (euler.*|rk4)", ANY, EXPLICIT, Divergence()),
    Known(
        r"23 ring of eight links: gap",
        r"stepper.*",
        (2e-3, 1.0),
        "the loop of a fast ring opens by more than 1e-5 m within a step of this length",
        Bound(
            lambda dt: RING * (3.0**2 / 0.2) * dt**2 / 2,
            "links of 0.2 m at 3 m/s leave their circles by v^2 / r dt^2 / 2 in a step, all eight in the same direction",
        ),
    ),
    Known(
        r"31 pinch at 1.01 of a cube.* 5 iterations",
        "stepper newton",
        (2e-2, 1.0),
        "five steps of Newton's method do not solve the first step, and no sweeps follow",
    ),
    Known(r"29 rolling coin", "stepper implicit", (4e-3, 1e-2), RULE),
    Known(r"30 wheel.*", "stepper newton", (2e-2, 1.0), "creeps at the residual of Newton's method, about 1e-9 m/s"),
    Known(r"S3 .*", r"stepper.*", (2e-3, 1e-2), "spheres overlap by about 3e-5 m while the heap falls together"),
    Known(
        r"S2 .*",
        FIRST_ORDER,
        ANY,
        RULE,
        Bound(lambda dt: (10 * BOUNCE * dt) ** 2, "ten bounces, each late by a whole step of gravity's work"),
    ),
    Known(
        r"33 .*",
        FIRST_ORDER,
        ANY,
        RULE,
        Slope(1.0, (2e-3, 1e-3, 5e-4), 0.02, "the table turns by 0.01 rad in the largest of these steps, which the second order adds"),
    ),
    Known(
        r"34 .*",
        EULER,
        ANY,
        RULE,
        Slope(1.0, (1e-3, 5e-4, 2.5e-4), 0.1, "the motion in a step is 0.08 of the distance of the centres in the largest of these steps"),
    ),
    Known(
        r"35 .*",
        FIRST_ORDER,
        ANY,
        RULE,
        Slope(1.0, (4e-3, 2e-3, 1e-3, 5e-4), 0.2, "the largest of twenty phases scatters by a half: log2(1.5) over three octaves"),
    ),
    Known(r"S3 .*", r"stepper.*", (2e-2, 1.0), HEAP, below(2e-4, MEASURED)),
    Known(r"S4 .*", "stepper fine", (2e-2, 1.0), HEAP, below(0.06, MEASURED)),
    Known(r"S4 .*", r"stepper( rk4| newton)?", (2e-2, 1.0), HEAP, below(0.5, MEASURED)),
    Known(r"15 table of four legs: order", COARSE, (2e-2, 1.0), TOLERANCE, below(8e-6, MEASURED)),
    Known(r"21 sliding over seams of tiles", "stepper newton", (4e-3, 1e-2), TOLERANCE, below(2e-4, MEASURED)),
    Known(r"30 wheel.*", "stepper implicit", ANY, TOLERANCE, below(1.5e-6, MEASURED)),
    Known(r"31 pinch.*", COARSE, (2e-2, 1.0), TOLERANCE, below(1.2e-2, MEASURED)),
    Known(r"S4 .*", r"stepper.*", (2e-2, 1.0), HEAP),
    Known(r"S4 .*", FIRST_ORDER, ANY, RULE, below(2e7, MEASURED)),
    Known(
        r"S5 .*",
        r"stepper( rk4| newton| fine)?",
        (0.0, 3e-3),
        "position correction keeps velocities: a displacement of a link by 1e-5 m changes the momentum by about 3e-4 kg m/s",
        below(1e-3**2, "three such links"),
    ),
    Known(r"S5 .*", r"stepper.*", (2e-2, 1.0), "the legs turn by 0.1 rad in a step", below(8e-3, MEASURED)),
    Known(
        r"S[56] .*",
        FIRST_ORDER,
        ANY,
        RULE,
        Slope(2.0, (2e-3, 1e-3, 5e-4), 0.05, "squares of an error of the first order; legs turn by 0.01 rad in the largest of these steps"),
    ),
    Known(
        r".*",
        "stepper f32",
        ANY,
        "numbers of 32 bits: velocities of order 1 m/s are 1e-7 m/s apart, and the solver's tolerance is no tighter",
    ),
)


def failure(title: str, engine: str, dt: float) -> Known | None:
    """Known failure of stepper in a scene. The result is None if the scene should pass."""
    for known in KNOWN:
        low, high = known.dts
        if re.fullmatch(known.scenes, title) and re.fullmatch(known.engines, engine) and low <= dt <= high:
            return known
    return None
