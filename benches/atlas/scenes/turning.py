"""Scene 33: a ball rolls on a turntable."""

import numpy as np

from atlas.mjcf import ball, document, free
from atlas.scene import Engine, Scene
from atlas.scenes.flight import second_order

TURN, RADIUS, MASS, THICK = 5.0, 0.05, 1.0, 0.1
"""Angular rate of the table, rad/s; radius (m) and mass (kg) of the ball; half thickness of the table, m."""
START, SPEED, SECONDS = 0.3, 0.4, 5.0
"""Initial distance of the ball from the axis, m; initial speed in the world frame, m/s; simulated time, s."""
RATE = 2 / 7 * TURN
"""Angular rate of the centre of a solid ball on its circle in the world frame, rad/s: two sevenths of the table's rate (Weltner 1979,
American Journal of Physics 47, 984)."""


def turntable() -> str:
    """MJCF of scene 33: a ball of 1 kg on a hinged turntable of 1000 t, which the ball does not slow down."""
    table = f"""<body name="table" pos="0 0 {-THICK}"><joint type="hinge" axis="0 0 1"/>
      <geom name="table" type="box" size="3 3 {THICK}" mass="1e6"/></body>"""
    return document(table + free("ball", ball(RADIUS, MASS), (START, 0, RADIUS)))


def rolling(engine: Engine, dt: float) -> float:
    """Error of scene 33, a ball on a turntable: largest error of its velocity, relative to its speed, sampled ten times per second."""
    world = engine.start(turntable(), dt)
    velocity = np.array([0.0, SPEED])
    # No slip: velocity + spin x (0, 0, -radius) is the velocity of the table at the contact.
    slip = np.array([0.0, TURN * START]) - velocity
    spin = np.array([slip[1], -slip[0]]) / RADIUS
    world.set(qvel=[TURN, *velocity, 0, *spin, 0])

    def error() -> float:
        exact = [-np.sin(RATE * world.seconds), np.cos(RATE * world.seconds)]
        return float(np.linalg.norm(world.qvel[0, 1:3] / SPEED - exact))

    return world.worst(error, round(SECONDS / 0.1), 0.1)


DTS = (1e-4, 5e-4, 2e-3, 5e-3, 1e-2)

SCENES = (
    Scene(
        "33",
        "ball on a turntable",
        "its centre moves on a circle in the world frame, at 2/7 of the table's rate",
        "Weltner 1979",
        "1",
        second_order(TURN),
        "square of the table's rotation per step: a second-order integrator",
        rolling,
        DTS,
        DTS,
    ),
)
