"""Scenes S1 to S7: the public tests of SimBenchmark.

S1 and S2 are rolling and bouncing bodies, S3 is a falling cube of 6 x 6 x 6 spheres ("666"), and S4 the same cube with elastic spheres.
S5 to S7 test the momentum, the energy and the standing of a quadruped. The scenes use the parameters in
github.com/leggedrobotics/SimBenchmark (benchmark/include, benchmark/res/yaml), without its code. Errors are defined as in
SimBenchmark: mean squares over all steps.
"""

import math

import numpy as np

from atlas.mjcf import FLOOR, G, ball, box, document, free
from atlas.quadruped import POSE, STAND, quadruped
from atlas.scene import Engine, Scene, flat
from atlas.world import World

SAMPLE = 0.01
"""Sampling interval of energy and penetration in the scenes of SimBenchmark, s."""

# S1. A plate of 20 x 20 x 1 m and 10 kg on the ground (mu 0.4), 25 balls of 1 kg on it (mu 0.8), 150 N on the plate, 60 degrees off x.

PLATE, BALL, COUNT, FORCE, MU = 10.0, 1.0, 25, 150.0, 0.4
WAY = np.array([0.5, math.sqrt(0.75), 0.0])
"""Direction of the force on the plate."""


def rolling_accelerations() -> tuple[float, float]:
    """Exact accelerations of plate and balls of scene S1, m/s^2.

    The friction f between the plate and each of n balls of mass m accelerates the ball's lowest point by f/m (1 + 5/2). The plate of mass
    M, pulled with the force F, accelerates by (F - mu (M + n m) g - n f) / M. Rolling without slip makes these accelerations equal.
    """
    driving = FORCE - MU * (PLATE + COUNT * BALL) * G
    f = driving / PLATE / (3.5 / BALL + COUNT / PLATE)
    return (driving - COUNT * f) / PLATE, f / BALL


def balls_on_plate() -> str:
    """MJCF of scene S1: a plate on the ground, and balls on the plate."""
    balls = "".join(
        free(f"ball{i}{j}", ball(0.5, BALL) + ' friction="0.8 0 0"', (2.0 * i - 4, 2.0 * j - 4, 1.5)) for i in range(5) for j in range(5)
    )
    return document(FLOOR + free("plate", box((10, 10, 0.5), PLATE), (0, 0, 0.5)) + balls, friction=MU)


def rolling(engine: Engine, dt: float) -> float:
    """Error of scene S1, balls on a pulled plate: mean squared error of velocities over 4 s, (m/s)^2.

    The velocities are those of the plate and of the first ball.
    """
    world = engine.start(balls_on_plate(), dt)
    world.push("plate", FORCE * WAY)
    plate, first = rolling_accelerations()
    errors = []
    for k in range(round(4.0 / dt)):
        v, t = world.qvel[0], k * dt
        errors.append(((v[:3] - plate * t * WAY) ** 2).sum() + ((v[6:9] - first * t * WAY) ** 2).sum())
        world.step()
    return float(np.mean(errors))


# S2. 7 x 7 spheres of 10 kg fall from 5 m and bounce for 20 s, with restitution 1 and without friction.


def _energy_error(world: World, seconds: float) -> float:
    """Mean squared deviation of the energy of an environment from its initial value over some time, J^2."""
    start = float(world.energy()[0])
    return world.mean(lambda: (float(world.energy()[0]) - start) ** 2, seconds, SAMPLE)


def bouncing(engine: Engine, dt: float) -> float:
    """Error of scene S2, 49 elastic spheres that bounce for 20 s: mean squared error of their energy of 24 kJ, J^2."""
    spheres = "".join(free(f"ball{i}{j}", ball(0.1, 10.0), (2.0 * i, 2.0 * j, 5.0)) for i in range(7) for j in range(7))
    return _energy_error(engine.start(document(FLOOR + spheres, friction=0.0), dt, restitution=1.0), 20.0)


# S3 and S4. 6 x 6 x 6 spheres of 10 kg, 1 cm apart, perturbed by up to 1 mm.


def spheres(height: float) -> str:
    """MJCF of scenes S3 and S4: a cube of 6 x 6 x 6 spheres, with the centres of the lowest layer at a height in m."""
    rng = np.random.default_rng(42)
    text = ""
    for i in range(6):
        for j in range(6):
            for k in range(6):
                at = 0.21 * np.array([i, j, k]) + 0.001 * rng.uniform(size=3) + [0, 0, height]
                text += free(f"ball{i}{j}{k}", ball(0.1, 10.0), at)
    return document(FLOOR + text, friction=0.0)


def falling_cube(engine: Engine, dt: float) -> float:
    """Error of scene S3, a falling cube of spheres: mean over 10 s of the sum of squared overlaps, m^2."""
    world = engine.start(spheres(0.101), dt, restitution=0.0)
    upper = np.triu_indices(216, 1)

    def overlaps() -> float:
        centres = world.qpos[0].reshape(216, 7)[:, :3]
        squares = (centres**2).sum(axis=1)
        apart = np.sqrt(np.maximum(squares[:, None] + squares - 2 * centres @ centres.T, 0.0))[upper]
        return float((np.maximum(0.2 - apart, 0.0) ** 2).sum() + (np.maximum(0.1 - centres[:, 2], 0.0) ** 2).sum())

    return world.mean(overlaps, 10.0, 10 * SAMPLE)


def elastic_cube(engine: Engine, dt: float) -> float:
    """Error of scene S4, a falling cube of elastic spheres: mean squared error of the energy over 10 s, J^2."""
    return _energy_error(engine.start(spheres(1.101), dt, restitution=1.0), 10.0)


# S5 to S7. The quadruped.


def _posed(world: World, height: float) -> np.ndarray:
    """Configuration of an environment with the quadruped in `POSE` at a height in m. The last 19 coordinates are the robot's."""
    qpos = world.qpos[0]
    qpos[-17] = height
    qpos[-12:] = POSE
    return qpos


def momentum(engine: Engine, dt: float) -> float:
    """Error of scene S5, a floating quadruped that a sphere of 10 kg hits at 5 m/s: mean squared error of linear momentum, (kg m/s)^2."""
    world = engine.start(quadruped(gravity=0.0, beside=free("ball", ball(0.2, 10.0), (0, -5, 2))), dt)
    qvel = np.zeros(world.model.nv)
    qvel[1] = 5.0
    world.set(_posed(world, 2.0), qvel)
    return world.mean(lambda: float(np.square(world.momentum()[0] - [0, 50.0, 0]).sum()), 10.0, SAMPLE)


def energy(engine: Engine, dt: float) -> float:
    """Error of scene S6, a flying quadruped: mean squared error of the energy over 2 s of free flight, J^2.

    An upward force of twice the weight acts for 1 s before.
    """
    world = engine.start(quadruped(), dt)
    world.set(_posed(world, 2.0), np.zeros(world.model.nv))
    world.push("trunk", (0, 0, 2 * float(world.model.body_subtreemass[0]) * G))
    world.run(1.0)
    world.push("trunk", (0, 0, 0))
    return _energy_error(world, 2.0)


GAINS = (400.0, 1.0)
"""Servo gains of the quadruped from SimBenchmark's header, N m/rad and N m s/rad.

With the 40 N m/rad of its yaml file this robot would fall: four legs give 160 N m/rad, less than m g h = 180 N m/rad.
"""


def standing(engine: Engine, dt: float) -> float:
    """Error of scene S7, a standing quadruped: largest velocity (m/s, rad/s) after ten seconds."""
    world = engine.start(quadruped(beside=FLOOR, gains=GAINS), dt)
    world.set(_posed(world, STAND), np.zeros(world.model.nv))
    world.run(10.0, POSE)
    if not 0.8 * STAND < world.qpos[0, 2] < STAND:
        return math.inf
    return float(np.abs(world.qvel).max())


def fourth(dt: float) -> float:
    """Tolerance for squared errors of a second-order integrator at the time step `dt`, s.

    The tolerance is 1e-8 at 1 ms, in the squared unit of the scene, and grows with the fourth power of the time step.
    """
    return 1e-8 * (dt / 1e-3) ** 4


FOURTH = "1e-8 at 1 ms, the square of a second-order error"
STEPS = (5e-4, 1e-3, 2e-3, 5e-3, 2e-2)
FEW = (5e-3, 2e-2)
CONSERVED = "conservation laws"

SCENES = (
    Scene(
        "S1",
        "rolling",
        "a plate pulled under 25 balls that roll on it",
        "Coulomb and Newton-Euler in closed form",
        "(m/s)^2",
        flat(1e-8),
        "1e-6 of the squared speeds",
        rolling,
        (1e-3, 2e-3, 5e-3, 2e-2),
        (1e-3, 5e-3),
    ),
    Scene(
        "S2",
        "bouncing",
        "the energy of 49 elastic spheres is constant",
        CONSERVED,
        "J^2",
        flat(1e-6),
        "4e-8 of the energy, squared",
        bouncing,
        STEPS,
        (5e-3, 2e-2),
    ),
    Scene(
        "S3",
        "666",
        "216 inelastic spheres do not overlap",
        "rigid bodies",
        "m^2",
        flat(216 * 3 * 1e-10),
        "three contacts per sphere with an overlap of 1e-5 m each",
        falling_cube,
        FEW,
        (1e-3, 2e-2),
    ),
    Scene(
        "S4",
        "elastic 666",
        "the energy of 216 elastic spheres is constant",
        CONSERVED,
        "J^2",
        flat(1e-6),
        "2e-8 of the energy, squared",
        elastic_cube,
        FEW,
        FEW,
    ),
    Scene(
        "S5",
        "quadruped's momentum",
        "constant, also when a ball hits the floating robot",
        CONSERVED,
        "(kg m/s)^2",
        fourth,
        FOURTH,
        momentum,
        STEPS,
        STEPS,
    ),
    Scene("S6", "quadruped's energy", "constant in free flight", CONSERVED, "J^2", fourth, FOURTH, energy, STEPS, STEPS),
    Scene(
        "S7",
        "quadruped's standing",
        "stands still",
        "statics",
        "m/s, rad/s",
        flat(1e-6),
        "the solver's tolerance",
        standing,
        STEPS,
        (1e-3, 5e-3),
    ),
)
