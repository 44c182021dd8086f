"""Scene 4: a sliding box stops.

Right answer: after v0^2 / (2 mu g), by the work of Coulomb's friction, and it stays there. A first-order integrator that holds the
friction for a whole step is off by h v0 / 2.
"""

import numpy as np
import pytest
from models import simulate
from numerics import slope
from scenes import BOX, DTS, G, every_choice, every_dt, on_plane

MU, V0 = 0.4, 1.7
DISTANCE = V0**2 / (2 * MU * G)


def stop(dt: float, choice: dict) -> float:
    """Distance at rest."""
    sim = simulate(on_plane(BOX, MU, 0.05), timestep=dt, tolerance=1e-6, **choice)
    sim.set_state(qvel=[V0, 0, 0, 0, 0, 0])
    sim.step(nstep=int(1.2 * V0 / (MU * G * dt)) + 2)
    sim.step(nstep=100)  # The warm start converges.
    stopped = sim.qpos
    sim.step(nstep=100)
    # At rest is at rest: nothing is left to creep but rounding.
    assert np.abs(sim.qvel).max() < 1e-12
    assert np.abs(sim.qpos - stopped).max() < 1e-12
    assert abs(sim.qpos[1]) < 1e-9
    return sim.qpos[0]


@every_dt
@every_choice
def test_error_is_within_half_a_step_of_sliding(dt, choice):
    """The velocity's recursion is exact until the last step, so h v0 / 2 bounds both rules; 1e-6 m is the solver's tolerance times 1 s."""
    assert abs(stop(dt, choice) - DISTANCE) < dt * V0 / 2 * 1.05 + 1e-6


@pytest.mark.parametrize("stabilization", ["baumgarte", "split"])
def test_eulers_error_falls_with_the_step(stabilization):
    """Slope 1 within 0.1: the remainder is the last, partial step, (h mu g)^2 / (2 mu g), of second order."""
    errors = [abs(stop(dt, {"integrator": "euler", "stabilization": stabilization}) - DISTANCE) for dt in DTS[:3]]
    assert slope(DTS[:3], errors) == pytest.approx(1.0, abs=0.1)
