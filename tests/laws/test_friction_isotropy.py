"""Scene 5: the same push in directions from 0 to 90 degrees.

Right answer: straight paths of equal length, because Coulomb's cone is round. Pyramids drift sideways and brake differently along their
edges.
"""

import numpy as np
import pytest
from models import simulate
from scenes import BOX, G, every_choice, every_dt, on_plane

MU, V0 = 0.4, 1.7
ANGLES = np.radians([0, 10, 22.5, 30, 45, 60, 67.5, 80, 90])


def paths(text: str, dt: float, choice: dict, yaw: float = 0.0) -> np.ndarray:
    """Where pushes in all directions end, along the push and across it."""
    sim = simulate(text, len(ANGLES), timestep=dt, tolerance=1e-6, **choice)
    qpos = sim.qpos.copy()
    qpos[:, 3:] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    along = np.array([np.cos(ANGLES), np.sin(ANGLES)]).T
    sim.set_state(qpos, np.hstack([V0 * along, np.zeros((len(ANGLES), 4))]))
    sim.step(nstep=int(1.2 * V0 / (MU * G * dt)) + 2)
    sim.step(nstep=100)  # The warm start converges.
    # At rest, the solver's tolerance is 1e4 machine epsilons of 1 m/s, 2.2e-12.
    assert np.abs(sim.qvel).max() < 2.5e-12
    end = sim.qpos[:, :2]
    return np.array([(end * along).sum(axis=1), end[:, 0] * along[:, 1] - end[:, 1] * along[:, 0]])


@every_dt
@every_choice
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_straight_and_equally_far(dt, choice, yaw):
    """Within a solver residual of 1e-6 m/s for the half second that the box slides."""
    along, across = paths(on_plane(BOX, MU, 0.05), dt, choice, yaw)
    assert np.ptp(along) < 1e-6
    assert np.abs(across).max() < 1e-6
    assert along.min() > 0.9 * (V0**2 / (2 * MU * G) - dt * V0)
