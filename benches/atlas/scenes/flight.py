"""Scenes 8 to 11: motion without contact. Energy and momentum are constant; right states are closed forms or converged solutions."""

import math
from functools import cache, partial

import mujoco
import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from atlas.mjcf import G, document
from atlas.quadruped import POSE, quadruped
from atlas.scene import Engine, Scene
from atlas.world import Array

# Scene 8: a body with three unequal inertias spins about its middle axis (Dzhanibekov). Landau & Lifshitz, Mechanics, section 37.

I1, I2, I3 = 0.010, 0.020, 0.026
SPIN, TOUCH = 5.0, 0.05
"""Initial angular velocities about the second and third axis, rad/s. The small one, about the third axis, starts the tumbling."""
ENERGY = (I2 * SPIN**2 + I3 * TOUCH**2) / 2
L2 = (I2 * SPIN) ** 2 + (I3 * TOUCH) ** 2
RATE = math.sqrt((I3 - I2) * (L2 - 2 * ENERGY * I1) / (I1 * I2 * I3))
M = (I2 - I1) * (2 * ENERGY * I3 - L2) / ((I3 - I2) * (L2 - 2 * ENERGY * I1))
PERIOD = 4 * float(ellipk(M)) / RATE
"""Period of the motion, s. `L2` is the squared angular momentum; `RATE` and `M` are rate and parameter of the elliptic functions."""


def omega(t: float) -> Array:
    """Exact angular velocity of scene 8's tumbling body in body axes at the time t (s), rad/s, by Jacobi's elliptic functions.

    The initial angular velocity is (0, SPIN, TOUCH).
    """
    sn, cn, dn, _ = ellipj(ellipk(M) + RATE * t, M)
    a1 = math.sqrt((2 * ENERGY * I3 - L2) / (I1 * (I3 - I1)))
    a2 = math.sqrt((2 * ENERGY * I3 - L2) / (I2 * (I3 - I2)))
    a3 = math.sqrt((L2 - 2 * ENERGY * I1) / (I3 * (I3 - I1)))
    return np.array([a1 * cn, a2 * sn, a3 * dn])


TUMBLER = document(f"""<body name="body"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{I1} {I2} {I3}"/>
  <geom type="box" size=".1 .1 .1" mass="0" contype="0" conaffinity="0"/></body>""", gravity=(0, 0, 0))  # fmt: skip
START = (0, 0, 0, 0, SPIN, TOUCH)


def tumbling(engine: Engine, dt: float) -> float:
    """Error of scene 8, a tumbling body: largest relative error of energy or angular momentum over a hundred periods.

    The error is sampled ten times per period.
    """
    world = engine.start(TUMBLER, dt)
    world.set(qvel=START)
    spin = np.array([0, I2 * SPIN, I3 * TOUCH])

    def error() -> float:
        return max(abs(world.energy()[0] / ENERGY - 1.0), np.linalg.norm(world.momentum()[1] - spin) / math.sqrt(L2))

    return world.worst(error, 1000, PERIOD / 10)


def flips(engine: Engine, dt: float) -> float:
    """Error of scene 8, a tumbling body: largest error of the angular velocity, relative to SPIN, at ten instants within one period."""
    world = engine.start(TUMBLER, dt)
    world.set(qvel=START)
    return world.worst(lambda: np.linalg.norm(world.qvel[0, 3:] - omega(world.seconds)) / SPIN, 10, PERIOD / 10)


def second_order(rate: float, factor: float = 1.0):
    """Function from the time step h (s) to a tolerance, `factor` times (rate h)^2: the error of a second-order integrator."""
    return lambda dt: factor * (rate * dt) ** 2


# Scene 9: the inertia of MuJoCo's issue 3553, once in the moving body and once in a child that is fixed to it.

FIXED = '<inertial pos="0 0 0" mass="0.12" diaginertia="0.00017231 0.00000658 0.00017243"/>'


def _spun(inside: str, engine: Engine, dt: float) -> Array:
    """Angular velocity of the tumbling body of scene 9 after 10,000 steps, (3,) rad/s.

    Args:
        inside: MJCF inside the body. Its placeholder {} gets the inertia and a geom, so that they are in the body or in a fixed child.
        engine: The engine.
        dt: Time step, s.
    """
    shape = '<geom type="sphere" size=".01" mass="0" contype="0" conaffinity="0"/>'
    world = engine.start(document(f'<body name="root"><freejoint/>{inside.format(FIXED + shape)}</body>', gravity=(0, 0, 0)), dt)
    world.set(qvel=[0, 0, 0, 20.0, 30.0, 10.0])
    world.step(10_000)
    return world.qvel[0, 3:]


def fixed_child(engine: Engine, dt: float) -> float:
    """Error of scene 9: relative difference of the angular velocities of two bodies after 10,000 steps.

    One body has the inertia itself, the other one in a fixed child. The exact difference is zero.
    """
    merged, nested = _spun("{}", engine, dt), _spun('<body name="child">{}</body>', engine, dt)
    return float(np.linalg.norm(nested - merged) / np.linalg.norm(merged))


# Scene 10: the quadruped floats and swings its legs.


def swimming(engine: Engine, dt: float) -> float:
    """Error of scene 10, a floating quadruped: sum of squares of linear (kg m/s) and angular (kg m^2/s) momentum.

    The error is measured after ten seconds in which all joints swing.
    """
    world = engine.start(quadruped(gravity=0.0, torques=True), dt)
    rng = np.random.default_rng(2)
    qpos = world.qpos[0]
    qpos[7:] = POSE
    world.set(qpos, np.zeros(world.model.nv))
    phase, every = rng.uniform(0, 2 * np.pi, 12), 0.04
    for k in range(round(10.0 / every)):
        world.run(every, 0.2 * np.sin(phase + 0.3 * k))
    linear, angular = world.momentum()
    return float(linear @ linear + angular @ angular)


# Scene 11: a double pendulum and a chain of five links.

LENGTH = 0.5


def chain(links: int) -> str:
    """MJCF of scene 11: a planar chain of hinged links of 0.5 m and 0.25 kg."""
    text = ""
    for k in range(links):
        text += f'<body pos="0 0 {-LENGTH if k else 0}"><joint axis="0 1 0"/>'
        text += f'<geom type="capsule" size=".03" mass="0.25" fromto="0 0 0 0 0 {-LENGTH}" contype="0" conaffinity="0"/>'
    return document(text + "</body>" * links)


@cache
def fastest(links: int) -> float:
    """Highest natural frequency of the hanging chain of scene 11, rad/s, from the linearized motion M q'' = -K q.

    M is the mass matrix. The stiffness matrix K comes from finite differences of the bias force by the joint angles q.
    """
    model = mujoco.MjModel.from_xml_string(chain(links))
    d, K, small = mujoco.MjData(model), np.zeros((links, links)), 1e-6
    for i in range(links):
        for sign in (1, -1):
            d.qpos[:] = 0
            d.qpos[i] = sign * small
            mujoco.mj_forward(model, d)
            K[:, i] += sign * d.qfrc_bias / (2 * small)
    d.qpos[:] = 0
    mujoco.mj_forward(model, d)
    M_full = np.zeros((links, links))
    mujoco.mj_fullM(model, d, M_full)
    return float(np.sqrt(np.linalg.eigvals(np.linalg.solve(M_full, K)).real.max()))


def _released(links: int) -> Array:
    """Initial joint angles of the chain of scene 11, rad: the first link is at 1.2 rad from the vertical, with the others in line."""
    qpos = np.zeros(links)
    qpos[0] = 1.2
    return qpos


@cache
def reference(links: int) -> Array:
    """Angles and rates of the chain of scene 11 after a second, rad and rad/s.

    The values come from the integrator DOP853 with MuJoCo's accelerations, rtol = atol = 1e-12.
    """
    model = mujoco.MjModel.from_xml_string(chain(links))
    d = mujoco.MjData(model)

    def rate(_: float, y: Array) -> Array:
        d.qpos[:], d.qvel[:] = np.split(y, 2)
        mujoco.mj_forward(model, d)
        return np.concatenate([d.qvel, d.qacc_smooth])

    start = np.concatenate([_released(links), np.zeros(links)])
    return np.asarray(solve_ivp(rate, (0.0, 1.0), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1])


def pendulum_state(engine: Engine, dt: float, links: int) -> float:
    """Error of scene 11, a swinging chain: largest error of an angle after one second, rad."""
    world = engine.start(chain(links), dt)
    world.set(_released(links), np.zeros(links))
    world.run(1.0)
    return float(np.abs(world.qpos[0] - reference(links)[:links]).max())


def pendulum_energy(engine: Engine, dt: float, links: int) -> float:
    """Error of scene 11, a swinging chain: largest deviation of the energy in five seconds.

    The deviation is relative to the work of lifting all links by one length.
    """
    world = engine.start(chain(links), dt)
    world.set(_released(links), np.zeros(links))
    start = world.energy()[0]
    return world.worst(lambda: abs(world.energy()[0] - start), 250, 0.02) / (links * 0.25 * G * LENGTH)


CONSERVED = "conservation laws"
SECOND = "(rate h)^2 of the fastest angular rate: a second-order integrator"

SCENES = (
    Scene("8", "tumbling: energy and momentum", "constant for a hundred periods", CONSERVED, "1", second_order(SPIN), SECOND, tumbling),
    Scene("8", "tumbling: flips", "Jacobi's elliptic functions", "Landau & Lifshitz, section 37", "1", second_order(SPIN), SECOND, flips),
    Scene(
        "9",
        "inertia on a fixed child",
        "as with the inertia merged into the parent",
        "rigid bodies",
        "1",
        lambda dt: 1e-6,
        "rounding of 10,000 steps, amplified by the tumbling",
        fixed_child,
        (1e-4, 1e-3),
        (1e-4, 1e-3),
    ),
    Scene(
        "10",
        "floating robot, internal torques",
        "zero momentum",
        CONSERVED,
        "(kg m/s)^2",
        lambda dt: 1e-8 * (dt / 1e-3) ** 4,
        "1e-8 at 1 ms, the square of a second-order error",
        swimming,
    ),
    *(
        scene
        for links, name in ((2, "double pendulum"), (5, "5-link chain"))
        for scene in (
            Scene(
                "11",
                f"{name}: energy",
                "constant",
                CONSERVED,
                "1",
                lambda dt, n=links: (fastest(n) * dt) ** 2,
                SECOND,
                partial(pendulum_energy, links=links),
            ),
            Scene(
                "11",
                f"{name}: state after 1 s",
                "a converged solution",
                "DOP853, rtol 1e-12",
                "rad",
                lambda dt, n=links: (fastest(n) * dt) ** 2,
                SECOND,
                partial(pendulum_state, links=links),
            ),
        )
    ),
)
