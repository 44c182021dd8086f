"""Scene 3: a box on an incline, a tenth of a degree to either side of the friction angle atan mu.

Right answer: below it the box does not move at all; above it, it slides with a = g (sin theta - mu cos theta). MuJoCo creeps at 44 to
888 um/s at 10 degrees with mu 1.
"""

import numpy as np
import pytest
from models import simulate
from scenes import BOX, G, every_choice, every_dt, on_plane

MU = 0.5
NEAR = np.radians(0.1)
CRITICAL = float(np.arctan(MU))


def slide(theta: float, steps: int, dt: float, choice: dict):
    """Distance downhill and speed after so many steps from rest, in one call."""
    sim = simulate(on_plane(BOX, MU, 0.05, theta), timestep=dt, **choice)
    start = sim.qpos[:3]
    sim.step(nstep=steps)
    assert sim.status == 0
    return np.linalg.norm(sim.qpos[:3] - start), np.linalg.norm(sim.qvel)


@every_dt
@every_choice
def test_below_the_friction_angle_nothing_moves(dt, choice):
    """Not by what a solver's tolerance could let creep: 1e-12 m/s is the rounding of g dt times the sweeps that a step may take."""
    distance, speed = slide(CRITICAL - NEAR, 100_000, dt, choice)
    assert speed < 1e-12
    assert distance < 1e-9


@every_dt
@every_choice
def test_above_it_the_box_accelerates_as_coulomb_says(dt, choice):
    """Constant acceleration is exact for both integrators' velocities; distance has Euler's g h^2 / 2 a step."""
    theta = CRITICAL + NEAR
    steps = 10_000
    distance, speed = slide(theta, steps, dt, choice)
    a, t = G * (np.sin(theta) - MU * np.cos(theta)), steps * dt
    # The tolerance of the solver, 1e-6 m/s, in every step: 1e-6 / (g cos theta mu dt) of the friction, of which a is a small difference.
    assert speed == pytest.approx(a * t, rel=1e-6)
    assert distance == pytest.approx(a * t * t / 2, rel=2 / steps)


def test_the_same_for_a_hundred_thousand_steps_of_sliding():
    theta = CRITICAL + NEAR
    distance, speed = slide(theta, 100_000, 2e-3, {})
    assert speed == pytest.approx(G * (np.sin(theta) - MU * np.cos(theta)) * 200, rel=1e-6)
