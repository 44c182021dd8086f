"""Surfaces that give way: springs and dampers in N/m and N s/m, under both laws of contact, against closed forms."""

import itertools

import numpy as np
import pytest
import stepper
from models import simulate
from scenes import G

RIGID = np.inf
LAWS = ("hard", "mujoco")
every_law = pytest.mark.parametrize("law", LAWS)

BALL = """<mujoco><option timestep="{dt}" gravity="0 0 {gravity}"/><default><geom friction="{mu} 0 0"/></default>
  <worldbody><geom name="floor" type="plane" size="0 0 1"/>
  <body pos="0 0 {height}"><freejoint/><geom name="ball" type="sphere" size=".1" mass="{mass}"/></body></worldbody></mujoco>"""
TABLE = """<mujoco><option timestep=".001" gravity="0 0 -9.81"/><worldbody><geom name="floor" type="plane" size="0 0 1" friction="1 0 0"/>
  <body pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".2 .1 .05" mass="4" friction="1 0 0"/>
  <geom name="load" type="sphere" size=".02" pos=".1 .02 .1" mass="2" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


def ball(stiffness, damping=0.0, *, dt=1e-3, height=0.1, mass=2.0, mu=0.5, gravity=-G):
    """A ball over a floor whose surface is a spring; the ball's own is rigid."""
    model = stepper.load(BALL.format(dt=dt, height=height, mass=mass, mu=mu, gravity=gravity))
    return model.replace(geom_stiffness=[stiffness, RIGID], geom_damping=[damping, 0.0])


def options(law, **more):
    return stepper.Options(contact=law, tolerance=1e-12, iterations=200, **more)


@every_law
@pytest.mark.parametrize("stiffness", [200.0, 1e4, 1e6])
def test_a_weight_sinks_in_by_its_weight_over_the_stiffness(law, stiffness):
    mass = 2.0
    damping = 2 * np.sqrt(stiffness * mass)  # critical
    sim = stepper.Stepper(ball(stiffness, damping, mass=mass), options=options(law))
    sim.step(nstep=6000)
    assert stepper.Status(sim.status) & ~stepper.Status.DEEP == stepper.Status.OK
    # Six seconds are fifty times the slowest time constant, sqrt(m / K) = 0.1 s.
    np.testing.assert_allclose(0.1 - sim.qpos[2], mass * G / stiffness, rtol=1e-9)
    assert abs(sim.qvel[2]) < 1e-10


@every_law
def test_two_surfaces_are_springs_in_series(law):
    floor, own = 3000.0, 6000.0
    model = ball(floor).replace(geom_stiffness=[floor, own], geom_damping=[90.0, 60.0])
    assert model.geom_stiffness.tolist() == [floor, own]
    sim = stepper.Stepper(model, options=options(law))
    sim.step(nstep=5000)
    np.testing.assert_allclose(0.1 - sim.qpos[2], 2.0 * G * (1 / floor + 1 / own), rtol=1e-9)


def bounce(law, dt, stiffness, damping, **more):
    """Speed after the bounce over that before it, and the time between touching and parting, of a ball without gravity."""
    model, speed = ball(stiffness, damping, dt=dt, height=0.1 + 1e-12, gravity=0.0), 1.0
    sim = stepper.Stepper(model, options=options(law, **more))
    sim.set_state(qvel=[0, 0, -speed, 0, 0, 0])
    steps, touching = 0, 0
    while sim.qvel[2] < 0 or sim.qpos[2] < 0.1:
        sim.step()
        touching += sim.qpos[2] < 0.1
        steps += 1
        assert steps < 1_000_000
    return sim.qvel[2] / speed, touching * dt


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.5])
def test_a_bounce_takes_half_a_period_and_loses_what_the_damper_takes(ratio):
    """Until its force would pull, it is a linear oscillator (Schwager and Poeschel, Granular Matter 9, 2007, eq. 17)."""
    stiffness, mass = 5000.0, 2.0
    w0 = np.sqrt(stiffness / mass)
    damping, beta = 2 * ratio * np.sqrt(stiffness * mass), ratio * w0
    w = np.sqrt(w0**2 - beta**2)
    duration = (np.pi - np.arctan2(2 * beta * w, w**2 - beta**2)) / w if ratio else np.pi / w
    restitution = np.exp(-beta * duration)
    errors = []
    for dt in (duration / 100, duration / 200, duration / 400):
        e, time = bounce("hard", dt, stiffness, damping, integrator="midpoint")
        errors.append(abs(e - restitution))
        # A ball that parts still overlaps while its damper has taken the force to zero; then it leaves at constant speed.
        if not ratio:
            assert abs(time - duration) <= 3 * dt
    # The first and the last step touch for a part of themselves only: an error of first order in the step.
    assert errors[0] < 0.02
    assert errors[2] < 0.35 * errors[0] or errors[0] < 1e-9, errors


@pytest.mark.parametrize(("law", "integrator"), [("hard", "euler"), ("hard", "midpoint"), ("mujoco", "euler")])
def test_an_undamped_spring_gains_no_energy(law, integrator):
    for stiffness, dt in itertools.product([1e2, 1e4, 1e6, 1e9], [1e-4, 1e-3, 1e-2]):
        e, _ = bounce(law, dt, stiffness, 0.0, integrator=integrator)
        # Rounding of a few hundred steps.
        assert e <= 1.0 + 1e-9, (stiffness, dt, e)


def test_both_laws_press_alike():
    """Euler's rule under both laws is the same implicit spring: the same motion while the contact lasts."""
    # From the first touch on: what closes within a step, hard contact sees a step earlier.
    model = ball(4000.0, 30.0, dt=1e-3, height=0.0999)
    hard, soft = (stepper.Stepper(model, options=options(law, integrator="euler")) for law in LAWS)
    for _ in range(400):
        hard.step()
        soft.step()
        # Numbers of the size of 0.1 m after 400 steps, each solved to 1e-12 m/s.
        np.testing.assert_allclose(hard.qpos, soft.qpos, rtol=0, atol=1e-10)


@every_law
def test_the_load_of_a_table_is_shared_as_springs_share_it(law):
    """Four corners carry what a rigid plate on equal springs does: the mean, and what the moments of the load add."""
    model = stepper.load(TABLE).replace(geom_stiffness=[2e5, RIGID, RIGID], geom_damping=[2e3, 0.0, 0.0])
    sim = stepper.Stepper(model, options=options(law))
    sim.step(nstep=4000)
    contacts = sim.contacts()
    assert len(contacts) == 4
    x, y, weight = 2 * 0.1 / 6, 2 * 0.02 / 6, 6 * G
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * [0.2, 0.1]
    expected = weight / 4 * (1 + x * corners[:, 0] / 0.2**2 + y * corners[:, 1] / 0.1**2)
    place = sim.qpos[:2]
    for corner, force in zip(corners, expected, strict=True):
        found = min(contacts, key=lambda c: np.linalg.norm(c["pos"][:2] - place - corner))
        # The plate leans by a millirad, which turns its arms by as much.
        np.testing.assert_allclose(found["force"][0], force, rtol=2e-3)


@pytest.mark.parametrize("mu", [0.3, 0.8])
def test_friction_is_that_of_the_force_that_the_spring_bears(mu):
    """A ball that slides without turning decelerates at mu g; and what holds does not creep."""
    sim = stepper.Stepper(ball(5e4, 500.0, mu=mu, mass=2.0), options=options("hard"))
    sim.step(nstep=1000)
    sim.set_state(qvel=[2.0, 0, 0, 0, 0, 0])
    sim.step(nstep=50)
    np.testing.assert_allclose(sim.qvel[0], 2.0 - mu * G * 0.05, rtol=1e-6)
    slope = np.arctan(0.5 * mu)
    held = stepper.load(TABLE.replace('friction="1 0 0"', f'friction="{mu} 0 0"')).replace(
        geom_stiffness=[2e5, RIGID, RIGID], geom_damping=[2e3, 0.0, 0.0], gravity=[G * np.sin(slope), 0.0, -G * np.cos(slope)]
    )
    sim = stepper.Stepper(held, options=options("hard"))
    sim.step(nstep=2000)
    before = sim.qpos.copy()
    sim.step(nstep=2000)
    # A thousandth of what a contact of MuJoCo's law creeps in two seconds.
    assert np.abs(sim.qpos - before).max() < 1e-8


def test_a_rigid_and_a_giving_surface_stand_side_by_side():
    """One ball on a spring, one on the floor's rigid neighbour: the spring's sinks in, the other does not, in one environment and lane."""
    model = stepper.load(
        """<mujoco><option timestep=".002"/><worldbody><geom type="box" size=".5 .5 .1" pos="-.6 0 -.1"/>
        <geom type="box" size=".5 .5 .1" pos=".6 0 -.1"/>
        <body pos="-.6 0 .1"><freejoint/><geom type="sphere" size=".1" mass="1"/></body>
        <body pos=".6 0 .1"><freejoint/><geom type="sphere" size=".1" mass="1"/></body></worldbody></mujoco>"""
    ).replace(geom_stiffness=[1e3, RIGID, RIGID, RIGID], geom_damping=[60.0, 0, 0, 0])
    sim = simulate(model, num_envs=3, steps=2000)
    np.testing.assert_allclose(0.1 - sim.qpos[:, 2], G / 1e3, rtol=1e-6)
    # The slop that the position solve leaves.
    assert np.all(np.abs(0.1 - sim.qpos[:, 9]) < 2e-4)
    assert np.all(sim.qpos[0] == sim.qpos[1])


def test_explicit_pairs_have_springs_of_their_own():
    xml = BALL.format(dt=1e-3, height=0.1, mass=2.0, mu=0.5, gravity=-G)
    model = stepper.load(xml.replace("</worldbody>", '</worldbody><contact><pair geom1="floor" geom2="ball"/></contact>'))
    assert model.pair_stiffness.tolist() == [RIGID]
    model = model.replace(pair_stiffness=[800.0], pair_damping=[80.0])
    sim = simulate(stepper.Model.from_bytes(model.to_bytes()), steps=4000)
    np.testing.assert_allclose(0.1 - sim.qpos[2], 2 * G / 800.0, rtol=1e-9)
    assert "compliant pairs" in model.explain()


@pytest.mark.parametrize(("fields", "words"), [
    ({"geom_stiffness": [0.0, RIGID]}, ["floor", "stiffness", "infinity"]),
    ({"geom_stiffness": [-5.0, RIGID]}, ["floor", "-5"]),
    ({"geom_stiffness": [np.nan, RIGID]}, ["floor", "NaN"]),
    ({"geom_damping": [3.0, 0.0]}, ["floor", "damping", "stiffness"]),
    ({"geom_stiffness": [1e3, RIGID], "geom_damping": [-1.0, 0.0]}, ["floor", "damping", "-1"]),
])  # fmt: skip
def test_springs_that_cannot_be_are_refused(fields, words):
    with pytest.raises(stepper.ModelError) as error:
        ball(1e3).replace(geom_damping=[0.0, 0.0], geom_stiffness=[RIGID, RIGID]).replace(**fields)
    assert all(word in str(error.value) for word in words), error.value
