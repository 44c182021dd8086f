"""A standing cylinder tips over its whole rim, a lying one rolls straight."""

import numpy as np
import pytest
from models import simulate

R, H, M, G = 0.1, 0.15, 2.0, 9.81
TEXT = f"""<mujoco><option gravity="0 0 -{G}"/><default><geom friction="1 0 0"/></default><worldbody><geom type="plane" size="0 0 1"/>
  <body pos="0 0 {{z}}" {{turn}}><freejoint/><geom type="cylinder" size="{R} {H}" mass="{M}"/></body></worldbody></mujoco>"""
DIRECTIONS = 24


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
@pytest.mark.parametrize("dt", [1e-4, 1e-3, 1e-2])
def test_it_tips_over_its_rim_and_over_nothing_less(dt, integrator):
    """A torque of m g r tips it, in every direction: a square of points would give way at 0.71 m g r."""
    turn = 'euler="0 0 17"'
    for share, tips in [(0.98, False), (1.02, True)]:
        sim = simulate(TEXT.format(z=H, turn=turn), DIRECTIONS, timestep=dt, integrator=integrator)
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


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_a_lying_cylinder_rolls_straight(integrator):
    """Without slip from the start it rolls for ever: nothing turns it off its way."""
    sim = simulate(TEXT.format(z=R, turn='euler="90 0 0"'), timestep=2e-3, integrator=integrator)
    qvel = sim.qvel.copy()
    qvel[0] = 1.0
    qvel[3:6] = [0.0, 0.0, -1.0 / R]  # Its axis, z in its own frame, is the world's -y.
    sim.set_state(qvel=qvel)
    sim.step(nstep=1000)
    assert sim.qvel[:3] == pytest.approx([1.0, 0.0, 0.0], abs=1e-5)
    assert sim.qpos[:3] == pytest.approx([2.0, 0.0, R], abs=1e-3)
