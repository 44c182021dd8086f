"""Scenes 4 and 5: a box is pushed in directions from 0 to 90 degrees, and slides until it stops.

Right answer: straight ahead for v0^2 / (2 mu g), by the work of Coulomb's friction, whose cone is round, and it stays there. Pyramids
drift sideways and brake differently along their edges. A first-order integrator, which holds the friction for a step, is off by h v0 / 2.
"""

import numpy as np
import pytest
from models import simulate
from numerics import slope
from scenes import BOX, DTS, G, every_choice, every_dt, on_plane

MU, V0 = 0.4, 1.7
DISTANCE = V0**2 / (2 * MU * G)
ANGLES = np.radians([0, 10, 22.5, 30, 45, 60, 67.5, 80, 90])


def paths(dt: float, choice: dict, yaw: float = 0.0) -> np.ndarray:
    """Where pushes in all directions end, along the push and across it."""
    sim = simulate(on_plane(BOX, MU, 0.05), len(ANGLES), timestep=dt, tolerance=1e-6, **choice)
    qpos = sim.qpos.copy()
    qpos[:, 3:] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    along = np.array([np.cos(ANGLES), np.sin(ANGLES)]).T
    sim.set_state(qpos, np.hstack([V0 * along, np.zeros((len(ANGLES), 4))]))
    sim.step(nstep=int(1.2 * V0 / (MU * G * dt)) + 2)
    sim.step(nstep=100)  # The warm start converges.
    stopped = sim.qpos.copy()
    sim.step(nstep=100)
    # At rest, the solver's tolerance is 1e4 machine epsilons of 1 m/s, 2.2e-12, and the way is that of the 100 steps.
    assert np.abs(sim.qvel).max() < 2.5e-12
    assert np.abs(sim.qpos - stopped).max() < 1e-12
    end = sim.qpos[:, :2]
    return np.array([(end * along).sum(axis=1), end[:, 0] * along[:, 1] - end[:, 1] * along[:, 0]])


@every_dt
@every_choice
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_it_stops_straight_ahead_and_equally_far_in_every_direction(dt, choice, yaw):
    """The velocity's recursion is exact until the last step, so h v0 / 2 bounds both rules; 1e-6 m is the solver's tolerance times 1 s."""
    along, across = paths(dt, choice, yaw)
    assert np.ptp(along) < 1e-6
    assert np.abs(across).max() < 1e-6
    assert np.abs(along - DISTANCE).max() < dt * V0 / 2 * 1.05 + 1e-6


@pytest.mark.parametrize("stabilization", ["baumgarte", "split"])
def test_eulers_error_falls_with_the_step(stabilization):
    """Slope 1 within 0.1: the remainder is the last, partial step, (h mu g)^2 / (2 mu g), of second order."""
    errors = [abs(paths(dt, {"integrator": "euler", "stabilization": stabilization})[0, 0] - DISTANCE) for dt in DTS[:3]]
    assert slope(DTS[:3], errors) == pytest.approx(1.0, abs=0.1)
