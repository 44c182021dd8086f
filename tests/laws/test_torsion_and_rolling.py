"""Contacts with torsional and rolling friction (condim 4 and 6): closed forms of what stops, the cone, and the certificate."""

import mujoco
import numpy as np
import pytest
import stepper
from models import simulate
from rotations import matrix

G = 9.81


def scene(geom: str, height: float, condim: int, friction: str) -> str:
    return f"""<mujoco><worldbody><geom type="plane" size="5 5 1" condim="{condim}" friction="{friction}"/>
      <body pos="0 0 {height}"><freejoint/><geom {geom} condim="{condim}" friction="{friction}" density="1000"/></body>
    </worldbody></mujoco>"""


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
@pytest.mark.parametrize("condim", [4, 6])
def test_a_spinning_sphere_stops_at_the_rate_of_torsional_friction(condim, integrator):
    """I w' = -mu_t m g with I = 2/5 m r^2: exactly linear, to rest within a step, and then it rests exactly."""
    r, mu, spin, h = 0.1, 0.002, 20.0, 1e-3
    sim = simulate(scene(f'type="sphere" size="{r}"', r, condim, f"1 {mu} .0001"), integrator=integrator, timestep=h, tolerance=1e-6)
    rate = mu * G / (0.4 * r * r)
    sim.set_state(qvel=[0, 0, 0, 0, 0, spin])
    for steps in (500, 500, 1000):
        sim.step(nstep=steps)
        # Rounding of the solver's tolerance, an angular velocity of 1e-6 m/s over mu, over the steps.
        assert sim.qvel[5] == pytest.approx(max(spin - rate * sim.time, 0.0), abs=1e-6)
        (contact,) = sim.contacts()
        assert contact["force"] == pytest.approx([sim.model.body_mass[1] * G, 0, 0], abs=1e-6)
        assert abs(contact["torque"][0]) == pytest.approx(mu * contact["force"][0] if sim.qvel[5] > 1e-9 else 0.0, abs=1e-6)
    sim.step(nstep=round(spin / rate / h))
    assert np.abs(sim.qvel).max() < 1e-9
    assert sim.status == stepper.Status.OK


def rolling(push: float, press: float, r: float, slide: float, roll: float) -> tuple[float, float]:
    """Acceleration of a ball that rolls under an acceleration `push` along the ground and `press` onto it, and its v / w.

    One cone holds sliding force f and torque t (per mass): (f / slide)^2 + (t / roll)^2 = press^2, opposed to the velocities in the same
    metric, so that a ball that rolls also slips a little: slip / f = (slide / roll)^2 w / t. With r' = v / w = r + slip / w:
    v' = push - f = r' (f r - t) / (2/5 r^2).
    """
    f, lever = 0.0, r
    for _ in range(200):
        t = roll * np.sqrt(press**2 - (f / slide) ** 2)
        lever = r + (roll / slide) ** 2 * f / t
        f = (push * 0.4 * r * r + lever * t) / (0.4 * r * r + lever * r)
    return push - f, lever


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_a_rolling_ball_is_stopped_by_rolling_friction(integrator):
    """Rate v' = -5/7 g mu_r / r but for what the force takes of the cone; it stops, and does not creep."""
    r, mu, speed, h = 0.1, 0.005, 1.0, 1e-3
    sim = simulate(scene(f'type="sphere" size="{r}"', r, 6, f"1 .003 {mu}"), integrator=integrator, timestep=h, tolerance=1e-6)
    rate, lever = rolling(0, G, r, 1, mu)
    assert rate == pytest.approx(-5 / 7 * G * mu / r, rel=2e-3)
    direction = np.array([np.cos(0.7), np.sin(0.7), 0])
    sim.set_state(qvel=np.concatenate([speed * direction, np.cross([0, 0, 1], direction) * speed / lever]))
    sim.step(nstep=1000)
    # A solver residual of 1e-6 m/s sums up to less than its like; velocities are linear in time, which both rules integrate exactly.
    assert sim.qvel[:3] == pytest.approx((speed + rate * sim.time) * direction, abs=2e-6)
    sim.step(nstep=round(-speed / rate / h) - 1000 + 5)
    stopped = sim.qpos[:3]
    assert np.abs(sim.qvel).max() < 1e-9
    # The distance v^2 / (2 a), up to the half step that each rule of integration is off.
    assert stopped[:2] == pytest.approx(-(speed**2) / (2 * rate) * direction[:2], abs=0.51 * speed * h)
    sim.step(nstep=2000)
    assert sim.qpos[:3] == pytest.approx(stopped, abs=1e-9)


def test_below_the_angle_of_rolling_friction_a_ball_rests():
    """On a slope the ground takes f = g sin and t = f r: both fit in the cone iff tan(angle) <= 1 / |(1 / mu, r / mu_r)|."""
    r, mu = 0.1, 0.01
    limit = np.arctan(1 / np.hypot(1, r / mu))
    for angle, holds in ((limit - 1e-4, True), (limit + 1e-4, False), (limit + 2e-2, False)):
        model = mujoco.MjModel.from_xml_string(scene(f'type="sphere" size="{r}"', r, 6, f"1 .005 {mu}"))
        model.opt.gravity[:] = G * np.array([np.sin(angle), 0, -np.cos(angle)])
        sim = simulate(model, timestep=2e-3)
        sim.step(nstep=1000)
        if holds:
            assert np.abs(sim.qvel).max() < 1e-9
            assert abs(sim.qpos[0]) < 1e-9
        else:
            rate, _ = rolling(G * np.sin(angle), G * np.cos(angle), r, 1, mu)
            assert sim.qvel[0] == pytest.approx(rate * sim.time, rel=1e-3)


def test_a_spinning_box_shares_friction_among_its_corners():
    """Torsional friction of four corners adds to what their sliding friction does at the distance of the corners."""
    a, mu, torsion = 0.1, 0.4, 0.02
    slower = {}
    for condim in (3, 4):
        sim = simulate(scene(f'type="box" size="{a} {a} .05"', 0.05, condim, f"{mu} {torsion} 0"), timestep=1e-3, iterations=500)
        sim.set_state(qvel=[0, 0, 0, 0, 0, 10.0])
        sim.step(nstep=100)
        slower[condim] = (10 - sim.qvel[5]) / sim.time
        sim.step(nstep=2000)
        assert np.abs(sim.qvel).max() < 1e-9
    arm, inertia = np.sqrt(2) * a, 2 / 3 * a * a  # I / m of a square of half side a
    # Each corner slips at w arm and turns at w: maximal dissipation over the ellipse gives n sqrt((mu arm)^2 + torsion^2) of torque.
    assert slower[3] == pytest.approx(G * mu * arm / inertia, rel=1e-3)
    assert slower[4] == pytest.approx(G * np.hypot(mu * arm, torsion) / inertia, rel=1e-3)


@pytest.mark.parametrize("condim", [4, 6])
def test_forces_are_in_the_elliptic_cone_and_oppose_the_slip(condim):
    """Thrown balls with spin: sum (f_i / mu_i)^2 <= f_n^2 in every step, on the surface while anything slips or turns."""
    mu = np.array([0.6, 0.6, 0.03, 0.01, 0.01])
    source = scene('type="sphere" size=".1"', 0.1, condim, "0.6 0.03 0.01")
    rng = np.random.default_rng(1)
    slid = 0
    for _ in range(5):
        sim = simulate(source, timestep=2e-3)
        sim.set_state(qvel=np.concatenate([rng.normal(size=2), [0], rng.normal(scale=20, size=3)]))
        for _ in range(200):
            sim.step()
            for contact in sim.contacts():
                force = np.concatenate([contact["force"], contact["torque"]])
                if condim == 4:
                    assert not force[4:].any()
                fraction = np.linalg.norm(force[1:] / mu) / force[0]
                assert fraction < 1 + 1e-12
                velocity = contact["frame"] @ (sim.qvel[:3] + np.cross(matrix(sim.qpos[3:7]) @ sim.qvel[3:], contact["pos"] - sim.qpos[:3]))
                turning = contact["frame"] @ matrix(sim.qpos[3:7]) @ sim.qvel[3:]
                scaled = np.concatenate([velocity[1:], turning])[: 3 if condim == 4 else 5] * (mu / mu[0])[: 3 if condim == 4 else 5]
                if np.linalg.norm(scaled) > 1e-3:
                    slid += 1
                    pull = (force[1:] * mu[0] / mu)[: len(scaled)]
                    # The velocity of the step's end is taken at its beginning's contact point: off by the turn within the step.
                    assert fraction > 1 - 1e-9
                    assert pull @ scaled < -(1 - 1e-2) * np.linalg.norm(pull) * np.linalg.norm(scaled)
    assert slid > 100


def test_a_friction_of_zero_costs_no_rows_and_changes_no_bit():
    """With condim 6 but without torsional and rolling friction it is condim 3, to the bit."""
    found = []
    for condim, friction in ((3, "0.7 0 0"), (6, "0.7 0 0")):
        sim = simulate(scene('type="box" size=".1 .2 .05"', 0.2, condim, friction), timestep=2e-3)
        sim.set_state(qvel=[1, 0.5, 0, 3, 2, 1])
        sim.step(nstep=300)
        found.append(np.concatenate([sim.qpos, sim.qvel]))
    assert np.array_equal(*found)


def test_a_contact_without_torsional_friction_has_no_torque():
    """Also if it had some before: coefficients can change between steps."""
    ball = '<body pos="0 0 .1"><freejoint/><geom name="ball" size=".1" condim="4" friction="1 .05 0"/></body>'
    sim = simulate(f'<mujoco><worldbody><geom type="plane" size="1 1 1" condim="1"/>{ball}</worldbody></mujoco>')
    sim.set_state(qvel=[0, 0, 0, 0, 0, 50])
    sim.step()
    assert abs(sim.contacts()["torque"][0, 0]) > 0.1
    sim.randomize({"geom_friction[ball][1]": 0.0, "geom_friction[0][1]": 0.0})
    sim.step()
    assert (sim.contacts()["torque"] == 0).all()
