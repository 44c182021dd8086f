"""Scene 6: a ball that slides begins to roll.

Right answer, from Coulomb's friction mu m g on a solid ball: it slips until t = 2 v0 / (7 mu g), over 12 v0^2 / (49 mu g), and rolls on
at 5 v0 / 7 for ever (its angular momentum about any point of its line of contact is constant).
"""

import numpy as np
import pytest
from models import simulate
from scenes import G, every_choice, every_dt, on_plane

MU, V0, RADIUS = 0.3, 2.0, 0.1
TIME, WAY, ROLLING = 2 * V0 / (7 * MU * G), 12 * V0**2 / (49 * MU * G), 5 * V0 / 7
BALL = f'type="sphere" size="{RADIUS}" mass="0.7"'


@every_dt
@every_choice
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_it_rolls_at_five_sevenths(dt, choice, angle):
    sim = simulate(on_plane(BALL, MU, RADIUS), timestep=dt, **choice)
    along = np.array([np.cos(angle), np.sin(angle), 0])
    sim.set_state(qvel=[*(V0 * along), 0, 0, 0])
    slipping, seconds = 0, 2.0
    for _ in range(round(seconds / dt)):
        sim.step()
        # Slip of a ball at rest in its own frame; twice the solver's tolerance is rolling.
        slipping += sim.qvel[:3] @ along - RADIUS * np.linalg.norm(sim.qvel[3:]) > 2e-6
    v = sim.qvel[:3]
    # The solver's tolerance is all that may be lost, once.
    assert v @ along == pytest.approx(ROLLING, abs=2e-6)
    assert np.linalg.norm(np.cross(v, along)) < 2e-6
    assert np.linalg.norm(sim.qvel[3:]) * RADIUS == pytest.approx(ROLLING, abs=4e-6)
    # The step in which slipping ends is one or the other; the way has the rule's error of half a step of the lost speed, and the tolerance.
    assert abs(slipping * dt - TIME) <= 1.001 * dt
    way = WAY + ROLLING * (seconds - TIME)
    assert abs(sim.qpos[:3] @ along - way) < dt * (V0 - ROLLING) / 2 * 1.05 + 4e-6 * seconds
