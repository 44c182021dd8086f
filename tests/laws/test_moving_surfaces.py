"""Surfaces that no degree of freedom moves: bodies that the user carries, and conveyors."""

import numpy as np
import pytest
from models import simulate

DT = 2e-3
PADDLE = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="paddle" mocap="true" pos="-1 0 0"><geom type="box" size=".1 .5 .5" friction="0 0 0"/></body>
  <body name="ball" pos="0 0 0"><freejoint/><geom type="sphere" size=".2" mass="2" friction="0 0 0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("nstep", [1, 5])
@pytest.mark.parametrize("integrator", ["midpoint", "euler", "implicit"])
def test_a_paddle_pushes_a_ball_with_its_own_speed(integrator, nstep):
    """It is never overlapped, not even when the user moves it at a control's rate of five steps, and the ball moves as it does."""
    sim = simulate(PADDLE, timestep=DT, integrator=integrator)
    speed = 0.8
    sim.step(nstep=nstep)
    for k in range(1, 1000 // nstep):
        sim.mocap_pos[0, 0] = -1 + speed * k * nstep * DT
        sim.step(nstep=nstep)
        assert sim.qpos[0] - sim.mocap_pos[0, 0] > 0.3 - 2e-5  # m: the slop and what is left of an impact.
    assert sim.qvel[0] == pytest.approx(speed, rel=1e-9)
    assert np.abs(np.delete(sim.qvel, 0)).max() < 1e-12


def test_a_tray_carries_by_friction():
    """A tray that starts with a < mu g carries a box without slip; one that starts with a > mu g gives it mu g."""
    text = """<mujoco><worldbody><body mocap="true"><geom type="plane" size="1 1 1" friction=".5 0 0"/></body>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction=".5 0 0"/></body></worldbody></mujoco>"""
    for acceleration, expected in [(2.0, 2.0), (9.0, 0.5 * 9.81)]:
        sim = simulate(text, timestep=DT)
        sim.step(nstep=100)  # Settle.
        start, count = sim.qvel[0], 100
        for k in range(1, count + 1):
            sim.mocap_pos[0, 0] = acceleration * (k * DT) ** 2 / 2
            sim.step()
        # The finite difference is the velocity of the middle of the step: half a step of acceleration is not there yet.
        assert sim.qvel[0] - start == pytest.approx(expected * (count - 0.5) * DT, rel=6e-3)


@pytest.mark.parametrize("integrator", ["midpoint", "euler"])
def test_a_conveyor_transports_at_belt_speed(integrator):
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1" surfacevel=".7 .2 5 0 0 0" friction=".6 0 0"/>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction=".6 0 0"/></body></worldbody></mujoco>"""
    sim = simulate(text, timestep=DT, integrator=integrator)
    sim.step(nstep=1000)
    assert sim.qvel[:2] == pytest.approx([0.7, 0.2], abs=1e-9)
    # The normal part of a surface velocity pushes nothing.
    assert abs(sim.qvel[2]) < 1e-9
    assert sim.qpos[2] == pytest.approx(0.1, abs=2e-5)


def test_after_a_reset_a_mocap_body_is_where_it_is_put():
    """The jump from the old episode to the new is no motion."""
    sim = simulate(PADDLE, timestep=DT)
    sim.step()
    sim.reset()
    sim.mocap_pos[0, 0] = -0.3
    sim.step()
    assert abs(sim.qvel[0]) < 1e-9


def test_the_last_pose_is_state():
    """Continuing from a saved state repeats the push of a paddle in motion, bit for bit."""

    def run(sim, first, last):
        for k in range(first, last):
            sim.mocap_pos[0, 0] = -0.5 + 0.8 * k * DT
            sim.step()
        return sim.qpos.copy(), sim.qvel.copy()

    sim, other = simulate(PADDLE, timestep=DT), simulate(PADDLE, timestep=DT)
    run(sim, 0, 150)
    other.set_state(sim.get_state())
    for a, b in zip(run(sim, 150, 300), run(other, 150, 300), strict=True):
        assert np.array_equal(a, b)
