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


def on_slope(theta: float, dt: float, choice: dict):
    """The box at rest on a plane of that slope."""
    return simulate(on_plane(BOX, MU, 0.05, theta), timestep=dt, **choice)


def acceleration(theta: float, steps: int, dt: float, choice: dict) -> float:
    """Mean over so many steps in one call, after the cold start is over; the way must be that of a constant acceleration."""
    sim = on_slope(theta, dt, choice)
    sim.step(nstep=100)
    place, speed, t = sim.qpos[:3], np.linalg.norm(sim.qvel[:3]), steps * dt
    sim.step(nstep=steps)
    gained = np.linalg.norm(sim.qvel[:3]) - speed
    # Exact for the midpoint rule; Euler's is half a step of the gained speed ahead.
    assert np.linalg.norm(sim.qpos[:3] - place) == pytest.approx(speed * t + gained * t / 2, rel=2 / steps)
    return gained / t


@every_dt
@every_choice
def test_below_the_friction_angle_nothing_moves_in_a_hundred_thousand_steps(dt, choice):
    """Nothing creeps: v = 0 to the rounding of g dt (1e-17 to 1e-15 m/s), once the warm start has converged.

    The four corners of the box share the load in many ways, and friction is nearly used up: from a cold start the solver may spend its
    sweeps for a few steps. It then says so, and the box moves by no more than the residual of those steps.
    """
    sim = on_slope(CRITICAL - NEAR, dt, choice)
    for _ in range(100):
        sim.step()
        # The residual is that of one corner; four make the body's velocity, each with up to 1 + mu of it.
        assert np.linalg.norm(sim.qvel[:3]) < 4 * (1 + MU) * max(sim.residual, 1e-15)
    start = sim.qpos
    sim.step(nstep=100_000)
    assert sim.status == 0
    assert np.abs(sim.qvel).max() < 1e-14
    assert np.abs(sim.qpos - start).max() < 1e-14 * 100_000 * dt


@every_choice
def test_below_the_friction_angle_nothing_moves_from_the_first_step(choice):
    """Given the sweeps: v = 0 to the tolerance, for every step from the cold start on."""
    sim = on_slope(CRITICAL - NEAR, 5e-3, choice | {"tolerance": 1e-13, "iterations": 100_000})
    for _ in range(20):
        sim.step()
        assert sim.status == 0
        assert np.linalg.norm(sim.qvel[:3]) < 1e-12


@every_dt
@every_choice
def test_above_it_the_box_accelerates_as_coulomb_says(dt, choice):
    """Once the warm start has converged, every step is solved to rounding; a is a thousandth of g, and carries a thousand times g's."""
    theta = CRITICAL + NEAR
    expected = G * (np.sin(theta) - MU * np.cos(theta))
    assert acceleration(theta, 100_000, dt, choice) == pytest.approx(expected, rel=1e-9)
