"""Scenes 18 to 20 and 31: jamming by friction and geometry: a wedge, Painleve's rod, two hinged boxes, a pinch grasp."""

import math
from functools import partial
from typing import TypeAlias

import numpy as np

from atlas.mjcf import FLOOR, G, about_y, ball, box, document, numbers
from atlas.scene import Engine, Scene, flat, unrest
from atlas.scenes.friction import ACCELERATION, COULOMB, CREEP, NO_CREEP, creep

# Scene 18: two jaws on slides squeeze a wedge of half-angle alpha without gravity. The wedge sticks iff tan alpha <= mu.

ALPHA = math.radians(15)
JAW, WEDGE, SQUEEZE, WIDTH, THICK = 1.0, 1.0, 50.0, 0.05, 0.01
"""Masses of a jaw and of the wedge, kg; force on a jaw, N; half width of the wedge at its middle, and half thickness of its plates, m."""


def wedge(factor: float) -> str:
    """MJCF of scene 18: two jaws on slides squeeze a wedge of half-angle alpha, a body of two plates that is wider at the top.

    The friction coefficient is factor * tan(alpha). The wedge sticks if the factor is at least 1.
    """
    plates, jaws = "", ""
    for side in (1, -1):
        normal = np.array([side * math.cos(ALPHA), 0.0, -math.sin(ALPHA)])
        face = np.array([side * WIDTH, 0.0, 0.0])
        turn = numbers(about_y(side * ALPHA))
        plates += f'<geom type="box" size="{THICK} .05 .05" pos="{numbers(face - THICK * normal)}" quat="{turn}" mass="{WEDGE / 2}"/>'
        jaw = f'<geom type="box" size="{THICK} .1 .1" quat="{turn}" mass="{JAW}"/>'
        jaws += f'<body name="jaw{side}" pos="{numbers(face + THICK * normal)}"><joint type="slide" axis="1 0 0"/>{jaw}</body>'
    body = f'<body name="wedge"><freejoint/>{plates}</body>'
    return document(body + jaws, friction=factor * math.tan(ALPHA), gravity=(0, 0, 0))


def _squeezed(engine: Engine, dt: float, factor: float):
    """Environment of scene 18 with a wedge of half-angle alpha that two jaws squeeze; the friction coefficient is factor * tan(alpha)."""
    world = engine.start(wedge(factor), dt)
    for side in (1, -1):
        world.push(f"jaw{side}", (-side * SQUEEZE, 0, 0))
    return world


def wedge_held(engine: Engine, dt: float) -> float:
    """Error of scene 18, a wedge of half-angle alpha between jaws: creep speed with mu = 1.01 tan(alpha), at which it must stick, m/s."""
    return creep(_squeezed(engine, dt, 1.01), 2000)


def wedge_expelled(engine: Engine, dt: float) -> float:
    """Error of scene 18, a wedge of half-angle alpha that jaws expel: relative error of its acceleration with mu = 0.9 tan(alpha).

    The wedge of mass m accelerates with a, and each jaw of mass M with a tan(alpha). A jaw is pushed by the force F, and its contact has
    the normal force N. Then m a = 2 N (sin(alpha) - mu cos(alpha)) and M a tan(alpha) = F - N (cos(alpha) + mu sin(alpha)).
    """
    mu, s, c = 0.9 * math.tan(ALPHA), math.sin(ALPHA), math.cos(ALPHA)
    right = SQUEEZE / (JAW * math.tan(ALPHA) + WEDGE * (c + mu * s) / (2 * (s - mu * c)))
    world = _squeezed(engine, dt, 0.9)
    seconds = max(0.02, 2 * dt)
    world.run(seconds)
    return abs(float(world.qvel[0, 2]) / (world.seconds * right) - 1.0)


# Scene 19: a slender rod slides on its tip. At tan theta = 2, Painleve's paradox occurs for mu > 4/3.

HALF, MASS, SLIDE = 0.5, 1.0, 1.0
INERTIA = MASS * HALF**2 / 3
THETA = math.atan(2.0)
TIP = 1e-4


def rod(mu: float) -> str:
    """MJCF of scene 19: a slender rod in the x-z plane; its lower tip is a small sphere on the floor."""
    c, s = math.cos(THETA), math.sin(THETA)
    inertia = f'<inertial pos="0 0 0" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>'
    tip = f'<geom type="sphere" size="{TIP}" pos="{numbers((HALF * c, 0, -HALF * s))}" mass="0"/>'
    return document(FLOOR + f'<body name="rod" pos="{numbers((0, 0, HALF * s + TIP))}"><freejoint/>{inertia}{tip}</body>', friction=mu)


def _contact() -> tuple[np.ndarray, np.ndarray]:
    """Contact Jacobian J (2, 3) of scene 19's rod, and inverse effective mass W = J M^-1 J^T (2, 2), 1/kg.

    J maps the rod's velocity (x, z, rotation about y) to the velocity of its contact point (x, z). M is the mass matrix of the rod.
    """
    x, z = HALF * math.cos(THETA), -HALF * math.sin(THETA) - TIP
    jacobian = np.array([[1.0, 0.0, z], [0.0, 1.0, -x]])
    return jacobian, jacobian @ np.diag([1 / MASS, 1 / MASS, 1 / INERTIA]) @ jacobian.T


def critical() -> float:
    """Critical friction of Painleve's paradox for scene 19's rod: (1 + 3 cos^2(theta)) / (3 sin(theta) cos(theta)).

    The angle between rod and floor is theta. Above this friction, a normal force on the sliding tip accelerates the tip into the floor.
    """
    _, w = _contact()
    return float(w[1, 1] / abs(w[0, 1]))


def _jamming() -> float:
    """Direction of sliding along x, 1 or -1, in which scene 19's rod jams: friction then presses the tip into the floor.

    The tip is ahead of the rod's centre in this direction.
    """
    return math.copysign(1.0, float(_contact()[1][0, 1]))


def _slide(engine: Engine, dt: float, mu: float) -> np.ndarray:
    """Velocity of scene 19's rod (x, z, rotation about y) after one step, m/s and rad/s.

    The rod starts with its tip sliding in the direction of jamming.
    """
    world = engine.start(rod(mu), dt)
    world.set(qvel=[_jamming() * SLIDE, 0, 0, 0, 0, 0])
    world.step()
    return world.qvel[0][[0, 2, 4]]


def right_velocity(mu: float, dt: float) -> np.ndarray:
    """Exact velocity of scene 19's rod after one step by Coulomb's law: x and z, m/s, and rotation about y, rad/s.

    The tip keeps sliding without normal velocity if this is possible. Otherwise the tip sticks.
    """
    jacobian, w = _contact()
    inverse = np.diag([1 / MASS, 1 / MASS, 1 / INERTIA])
    free = np.array([_jamming() * SLIDE, -G * dt, 0.0])
    wrench = jacobian.T @ np.array([-_jamming() * mu, 1.0])
    yields = float((jacobian @ inverse @ wrench)[1])
    if yields > 0:
        slid = free - inverse @ wrench * (jacobian @ free)[1] / yields
        if (jacobian @ slid)[0] * _jamming() > 0:
            return slid
    return free - inverse @ jacobian.T @ np.linalg.solve(w, jacobian @ free)


def painleve(engine: Engine, dt: float, factor: float) -> float:
    """Error of scene 19, Painleve's rod with `factor` times the critical friction: error of its velocity after a step, m/s and rad/s."""
    mu = factor * critical()
    return float(np.abs(_slide(engine, dt, mu) - right_velocity(mu, dt)).max())


# Scene 20: two boxes on parallel hinges fall against each other until their faces meet, as in DART's issue 892.

SIDE = 0.1


def hinged() -> str:
    """MJCF of scene 20: two cubes hinged to the world at their outer lower edges. In the upright pose their inner faces coincide."""
    text = ""
    for side in (1, -1):
        text += f'<body pos="{side * 2 * SIDE} 0 0"><joint type="hinge" axis="0 {-side} 0"/>'
        text += f'<geom type="box" size="{SIDE} {SIDE} {SIDE}" pos="{-side * SIDE} 0 {SIDE}" mass="1"/></body>'
    return document(text, friction=0.5)


# Scene 31: two fingers on a carriage pinch an object of mass m with the force F each, and lift it with the acceleration a = LIFT. The grasp
# holds iff mu >= m (g + a) / (2 F).

OBJECT, LIFT, FINGER, CARRIAGE = 0.2, 2.0, 0.1, 1e3
Pinch: TypeAlias = tuple[float, str, int | None]
"""Case of scene 31, a pinch grasp: friction, shape of the object ("cube" or "ball"), iterations of the solver (None: the default)."""
PINCHES: tuple[Pinch, ...] = (
    (0.2, "ball", None),
    (0.5, "ball", 5),
    (1.0, "ball", 20),
    (0.2, "cube", None),
    (0.5, "cube", 5),
    (0.5, "cube", 20),
    (1.0, "cube", None),
)

HELD = {"cube": box((0.02, 0.02, 0.02), OBJECT), "ball": ball(0.02, OBJECT)}
"""Geoms of the objects of scene 31 by shape. A ball has one contact point per side.

A cube has four contact points per side. Statics determines only the sum of their loads.
"""


def pinch(mu: float, shape: str) -> str:
    """MJCF of scene 31: a free object between two fingers on slides with force motors, on a heavy carriage that hardly slows down."""
    fingers, motors = "", ""
    for side in (1, -1):
        fingers += f'<body name="finger{side}" pos="{side * 0.03} 0 0"><joint name="finger{side}" type="slide" axis="{-side} 0 0"/>'
        fingers += f'<geom type="box" size=".01 .05 .05" mass="{FINGER}"/></body>'
        motors += f'<motor joint="finger{side}"/>'
    carriage = f'<geom type="sphere" size=".01" pos="0 0 .3" mass="{CARRIAGE}" contype="0" conaffinity="0"/>'
    hand = f'<body name="hand"><joint type="slide" axis="0 0 1"/>{carriage}{fingers}</body>'
    held = f'<body name="object"><freejoint/><geom {HELD[shape]}/></body>'
    return document(hand + held, friction=mu, after=f"<actuator>{motors}</actuator>")


def _lifted(engine: Engine, dt: float, case: Pinch, factor: float) -> tuple[float, float]:
    """Motion of scene 31's object relative to the hand from 0.25 s to 0.5 s: slip, m, and mean downward acceleration, m/s^2."""
    mu, shape, iterations = case
    world = engine.start(pinch(mu, shape), dt, iterations=iterations)
    force = OBJECT * (G + LIFT) / (2 * mu) * factor
    squeeze = [force, force]
    world.push("hand", (0, 0, (CARRIAGE + 2 * FINGER + OBJECT) * (G + LIFT)))
    world.run(0.25, squeeze)
    start, before = world.qpos[0, 5] - world.qpos[0, 0], world.qvel[0, 5] - world.qvel[0, 0]
    world.run(0.25, squeeze)
    seconds = round(0.25 / dt) * dt
    end, after = world.qpos[0, 5] - world.qpos[0, 0], world.qvel[0, 5] - world.qvel[0, 0]
    return abs(float(end - start)), float(before - after) / seconds


def pinch_holds(engine: Engine, dt: float, case: Pinch) -> float:
    """Error of scene 31, a pinch grasp with 1.01 of the required finger force: slip speed, m/s."""
    return _lifted(engine, dt, case, 1.01)[0] / 0.25


def pinch_slips(engine: Engine, dt: float, case: Pinch) -> float:
    """Error of scene 31, a pinch grasp with 0.99 of the required finger force: relative error of the slip acceleration.

    The slip acceleration must be 0.01 (g + a), where a is the hand's upward acceleration.
    """
    return abs(_lifted(engine, dt, case, 0.99)[1] / (0.01 * (G + LIFT)) - 1.0)


ALIGNED = partial(unrest, mjcf=hinged(), qpos=[-0.3, -0.3], seconds=5.0)
REST = "1e-5 m of penetration over 0.2 m"
TIMES = (1e-4, 2e-3, 2e-2)

SCENES = (
    Scene("18", "wedge, mu = 1.01 tan alpha", "held", COULOMB, "m/s", flat(CREEP), NO_CREEP, wedge_held),
    Scene(
        "18",
        "wedge, mu = 0.9 tan alpha",
        "expelled with the acceleration of two jaws and a wedge",
        COULOMB,
        "1",
        flat(1e-3),
        "rotation of jaws and wedge within the solver's tolerance",
        wedge_expelled,
    ),
    Scene(
        "19",
        "Painleve rod, mu 5 % above critical",
        "the tip stops at once (impact without collision)",
        "Darboux-Keller: the impulse can only end in sticking",
        "m/s",
        flat(1e-6),
        "the solver's tolerance",
        partial(painleve, factor=1.05),
    ),
    Scene(
        "19",
        "Painleve rod, mu 5 % below critical",
        "the tip slides, or stops if the friction of a step suffices",
        COULOMB,
        "m/s",
        flat(1e-6),
        "the solver's tolerance",
        partial(painleve, factor=0.95),
    ),
    Scene("20", "two hinged boxes, faces aligned", "rest upright, face to face", "statics", "rad, rad/s", flat(1e-4), REST, ALIGNED),
    *(
        scene
        for mu, shape, n in PINCHES
        for suffix in (f" of a {shape}, mu {mu}" + (f", {n} iterations" if n else ""),)
        for scene in (
            Scene(
                "31",
                f"pinch at 1.01{suffix}",
                "holds at mu >= m (g + a) / 2 F",
                COULOMB,
                "m/s",
                flat(CREEP),
                NO_CREEP,
                partial(pinch_holds, case=(mu, shape, n)),
                TIMES,
                (2e-3,),
            ),
            Scene(
                "31",
                f"pinch at 0.99{suffix}",
                "slips with 0.01 (g + a)",
                COULOMB,
                "1",
                flat(1e-3),
                ACCELERATION,
                partial(pinch_slips, case=(mu, shape, n)),
                TIMES,
                (2e-3,),
            ),
        )
    ),
)
