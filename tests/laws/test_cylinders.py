"""A standing cylinder tips over its whole rim."""

import numpy as np
import pytest
from models import simulate

R, H, M, G = 0.1, 0.15, 2.0, 9.81
TEXT = f"""<mujoco><option gravity="0 0 -{G}"/><default><geom friction="1 0 0"/></default><worldbody><geom type="plane" size="0 0 1"/>
  <body pos="0 0 {H}" euler="0 0 17"><freejoint/><geom type="cylinder" size="{R} {H}" mass="{M}"/></body></worldbody></mujoco>"""
DIRECTIONS = 24


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
@pytest.mark.parametrize("dt", [1e-4, 1e-3, 1e-2])
def test_it_tips_over_its_rim_and_over_nothing_less(dt, integrator):
    """A torque of m g r tips it, in every direction: a square of points would give way at 0.71 m g r."""
    for share, tips in [(0.98, False), (1.02, True)]:
        sim = simulate(TEXT, DIRECTIONS, timestep=dt, integrator=integrator)
        angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
        sim.xfrc_applied[:, 1, 3] = share * M * G * R * np.cos(angle)
        sim.xfrc_applied[:, 1, 4] = share * M * G * R * np.sin(angle)
        sim.step(nstep=round(0.5 / dt))
        lean = 2 * np.linalg.norm(sim.qpos[:, 4:6], axis=1)
        if tips:
            # Beyond the balance the torque left over, 2 % of m g r, turns it about the rim.
            inertia = M * (R**2 / 4 + H**2 / 3) + M * (R**2 + H**2)
            assert (lean > 0.5 * 0.02 * M * G * R / inertia * 0.5**2 * 0.5).all()
        else:
            assert (lean < 1e-3).all()
            assert np.abs(sim.qvel).max() < 1e-2
