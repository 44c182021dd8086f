"""What stepper does not hold, and why: the tests expect exactly these to fail, and the table prints the reasons."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Known:
    """Failures with one reason.

    Attributes:
        scenes: Pattern of "number name".
        engines: Pattern of the engine's name in the table.
        dts: Smallest and largest time step, s.
        reason: Why.
    """

    scenes: str
    engines: str
    dts: tuple[float, float]
    reason: str


ANY = (0.0, 1.0)
EULER = r"stepper euler.*"
NOT_EULER = r"stepper(?! euler).*"

BAUMGARTE = r"stepper (euler, )?baumgarte"
EXPLICIT = "springs and servos are explicit with this integrator, as in MuJoCo's: stable up to h sqrt(k/m) = 2"
HEAP = "a heap of 216 spheres at this time step falls by more than a radius of theirs in a few steps; what the law leaves open decides"

KNOWN: tuple[Known, ...] = (
    Known(
        r"[12] .*",
        NOT_EULER,
        (2e-2, 1.0),
        "the textbook's recursion bounces at the end of the step; the midpoint rule does where the floor is met, and gravity "
        "acts on what is left of the step",
    ),
    Known(r"(8|10|11) .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(r"40 .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(
        r"(36 .*|39 .*)",
        BAUMGARTE,
        ANY,
        "what Baumgarte's method adds to velocities stays in the motion, and where demands contradict one another it never ends",
    ),
    Known(r"37 a slot .*", BAUMGARTE, (0.0, 2e-4), "demands that contradict one another: impulses of 1e10 N s hold the box where it is"),
    Known(r"40 .*", "stepper f32", (0.0, 1e-4), "the rounding of 50,000 steps in single precision"),
    Known(
        r"41 pushed box at 0.999 .*",
        "stepper f32",
        (3e-4, 3e-3),
        "single precision leaves velocities to 1e-5 m/s, and the box some 1e-6 rad",
    ),
    Known(
        r"41 .* 1.001 .*", "stepper f32", (0.0, 2e-4), "the rounding of 10,000 steps in single precision, beside a thousandth of the weight"
    ),
    Known(r"9 .*", EULER, ANY, "Euler's rule takes Coriolis and centrifugal forces at the beginning of the step, and gains energy"),
    Known(
        r"13 .*tension",
        r"stepper.*",
        (5e-3, 1.0),
        "the chain goes on swinging along its length at this time step; the mean tension is right",
    ),
    Known(
        r"16 arch of 17 blocks",
        "stepper newton",
        (0.0, 1e-3),
        "Newton's method alone leaves one step unsolved (its status says so), and blocks slip by what it leaves",
    ),
    Known(r"17 .*|29 Euler.*", BAUMGARTE, ANY, "Baumgarte's velocity stays in the motion as kinetic energy"),
    Known(r"22 .* = (2|10|100)", EULER, ANY, EXPLICIT),
    Known(r"22 .* = (10|100)", "stepper rk4", ANY, EXPLICIT),
    Known(
        r"23 ring of eight links: gap",
        r"stepper.*",
        (2e-3, 1.0),
        "the loop of a fast ring opens by more than 1e-5 m within a step of this length",
    ),
    Known(r"27 .*", r"stepper.*", (0.0, 5e-3), "rounding of positions at 1e5 m, 1.5e-11 m, gathers to some 3e-9 m"),
    Known(
        r"31 pinch at 1.01 of a cube.* 5 iterations",
        "stepper newton",
        (2e-2, 1.0),
        "five steps of Newton's method do not solve the first step, and no sweeps follow",
    ),
    Known(r"29 rolling coin", "stepper implicit", (4e-3, 1e-2), "a rule of the first order"),
    Known(r"30 wheel.*", "stepper newton", (2e-2, 1.0), "creeps at the speed that Newton's method leaves, some 1e-9 m/s"),
    Known(r"S3 .*", r"stepper.*", (5e-3, 1e-2), "spheres overlap by some 3e-5 m while the heap falls together"),
    Known(r"S2 .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(r"3[345] .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(r"S[34] .*", r"stepper.*", (2e-2, 1.0), HEAP),
    Known(
        r"S5 .*",
        r"stepper( rk4| newton)?",
        (0.0, 3e-3),
        "positions are corrected at unchanged velocities: a link that is moved by 1e-5 m changes the momentum by some 3e-4 kg m/s",
    ),
    Known(r"S5 .*", r"stepper.*", (2e-2, 1.0), "the legs turn by 0.1 rad in a step"),
    Known(r"S5 .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(r"S6 .*", r"stepper (euler.*|implicit)", ANY, "rules of the first order"),
    Known(
        r".*",
        "stepper f32",
        ANY,
        "numbers of 32 bits: velocities of order 1 m/s are 1e-7 m/s apart, and the solver's tolerance is no tighter",
    ),
)


def reason(title: str, engine: str, dt: float) -> str | None:
    """Why stepper does not hold a scene ("number name") with a setting at a time step; None where it should."""
    for known in KNOWN:
        low, high = known.dts
        if re.fullmatch(known.scenes, title) and re.fullmatch(known.engines, engine) and low <= dt <= high:
            return known.reason
    return None
