"""Rolling and riding on surfaces that move is of second order: friction asks for the velocity of the place where the contact will be.

A solid ball's centre moves on a circle in the room, with two sevenths of the table's rate (Weltner 1979, American Journal of
Physics 47, 984). The bounds of slopes are 1.9: 2 with what a fit leaves open where errors of the next order are still seen.
"""

import numpy as np
import pytest
import stepper
from numerics import slope

DTS = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4]
TURN, R, START, SPEED, SECONDS = 3.0, 0.05, 0.3, 0.4, 2.0  # rad/s, m, m from the axis, m/s, s
BALL = f'<body pos="{START} 0 {R}"><freejoint/><geom size="{R}" mass="1"/></body>'
HINGED = '<body pos="0 0 -.1"><joint axis="0 0 1"/><geom type="box" size="3 3 .1" mass="1e6"/></body>'
# The velocity of the ball alone, without slip: v + w x (0, 0, -R) is that of the table there.
ROLLS = [0, SPEED, 0, (TURN * START - SPEED) / R, 0, 0]


def start(world: str, dt: float, integrator: str = "midpoint") -> stepper.Stepper:
    model = stepper.load(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    return stepper.Stepper(model, options=stepper.Options(timestep=dt, integrator=integrator))


def off_circle(velocity, seconds: float) -> float:
    angle = 2 / 7 * TURN * seconds
    return float(np.abs(velocity - SPEED * np.array([-np.sin(angle), np.cos(angle)])).max()) / SPEED


def on_a_conveyor_that_turns(dt: float, integrator: str = "midpoint") -> float:
    sim = start(f'<geom type="plane" size="9 9 1" surfacevel="0 0 0 0 0 {TURN}"/>' + BALL, dt, integrator)
    sim.set_state(qvel=ROLLS)
    sim.step(nstep=round(SECONDS / dt))
    return off_circle(sim.qvel[:2], SECONDS)


def on_a_table_of_the_users(dt: float, integrator: str = "midpoint") -> float:
    """From the second call on: before the first one the table had no pose, so that it rests in that."""
    sim = start('<body mocap="true"><geom type="plane" size="9 9 1"/></body>' + BALL, dt, integrator)
    sim.set_state(qvel=ROLLS)
    calls, steps, velocities = 25, round(0.08 / dt), []
    for k in range(calls):
        angle = TURN * steps * dt * k
        sim.mocap_quat[0] = [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]
        sim.step(nstep=steps)
        velocities.append(sim.qvel[:2].copy())
    angle = 2 / 7 * TURN * steps * dt * (calls - 2)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ velocities[1]
    return float(np.abs(velocities[-1] - turned).max()) / SPEED


@pytest.mark.parametrize("integrator", ["midpoint", "rk4"])
@pytest.mark.parametrize("measure", [on_a_conveyor_that_turns, on_a_table_of_the_users])
def test_a_ball_on_a_turntable_is_of_second_order(measure, integrator):
    """Scene 33 of the atlas has a table on a hinge."""
    errors = [measure(dt, integrator) for dt in DTS]
    assert slope(DTS, errors) > 1.9
    assert errors[2] < (TURN * DTS[2]) ** 2


def test_a_box_rides_on_a_turntable():
    """It keeps its place, and comes around with the table."""
    ride = '<body pos=".3 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction="2 0 0"/></body>'

    def measure(dt):
        sim = start(HINGED + ride, dt)
        sim.set_state(qvel=[TURN, 0, TURN * 0.3, 0, 0, 0, TURN])
        sim.step(nstep=round(SECONDS / dt))
        angle = TURN * SECONDS
        return float(np.abs(sim.qpos[1:3] - 0.3 * np.array([np.cos(angle), np.sin(angle)])).max())

    errors = [measure(dt) for dt in DTS]
    assert slope(DTS, errors) > 1.9
    assert errors[2] < (TURN * DTS[2]) ** 2


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_a_ball_on_a_ball_is_of_second_order(turn):
    """The place of the contact moves with both centres."""
    top = np.sqrt(0.6**2 - 0.1**2)
    world = '<body><joint axis="0 0 1"/><geom size=".5" mass="1e6"/></body>'
    world += f'<body pos=".1 0 {top}"><freejoint/><geom size=".1" mass="1" friction="2 0 0"/></body>'

    def end(dt):
        sim = start(world, dt)
        # It begins at rest on the other's surface.
        sim.set_state(qvel=[turn, 0, turn * 0.1, 0, 0, 0, turn])
        sim.step(nstep=round(0.4 / dt))
        return np.concatenate([sim.qpos[1:4], sim.qvel[1:4]])

    exact, dts = end(1e-4 / 2), [8e-3, 4e-3, 2e-3, 1e-3]
    assert slope(dts, [np.abs(end(dt) - exact).max() for dt in dts]) > 1.8  # The finest differs from the reference by 1/400 of itself.


def test_a_ball_that_rolls_down_a_slope_is_exact():
    """7/5 of its mass is moved; positions are those of a parabola."""
    for dt in (1e-3, 8e-3):
        model = stepper.load(f"""<mujoco><option gravity="2 0 -9.6"/><worldbody><geom type="plane" size="9 9 1"/>
          <body pos="0 0 {R}"><freejoint/><geom size="{R}" mass="1"/></body></worldbody></mujoco>""")
        sim = stepper.Stepper(model, options=stepper.Options(timestep=dt))
        sim.step(nstep=round(2 / dt))
        assert sim.qvel[0] == pytest.approx(2 * 5 / 7 * 2, abs=1e-9)
        assert sim.qpos[0] == pytest.approx(2 * 5 / 7 * 2, abs=1e-4)  # v t / 2; it begins by settling on the plane.
