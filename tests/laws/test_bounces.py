"""Scene 7, one sphere: a bounce by Newton's law, v+ = -e v-. Apexes are e^(2n) H; with e = 1 the energy is constant."""

import numpy as np
import pytest
import stepper

RADIUS, HEIGHT, GRAVITY = 0.1, 0.9, 9.81  # m, m above the floor, m/s^2
BALL = f"""<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 {RADIUS + HEIGHT}"><freejoint/><geom size="{RADIUS}" mass="1"/></body></worldbody></mujoco>"""


def dropped(restitution: float, dt: float, integrator: str = "midpoint") -> stepper.Stepper:
    model = stepper.load(BALL).replace(geom_restitution=[0.0, restitution])  # A pair takes the larger.
    return stepper.Stepper(model, options=stepper.Options(timestep=dt, integrator=integrator))


@pytest.mark.parametrize("dt", [5e-4, 2e-3, 1e-2])
def test_an_elastic_sphere_keeps_its_energy_for_twenty_seconds(dt):
    sim = dropped(1.0, dt)
    energy = sum(sim.energy())
    sim.step(nstep=round(20 / dt))
    # The midpoint rule reverses the velocity at an unchanged height: what is left is rounding, some 1e-16 a step.
    assert sum(sim.energy()) == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("integrator", ["midpoint", "euler"])
def test_apexes_follow_the_law_to_first_order(integrator):
    """It bounces within a step of the floor, so heights are off by up to the way of a step at each bounce: first order."""
    errors = []
    for dt in (2e-3, 2.5e-4):
        sim, apexes, before = dropped(0.5, dt, integrator), [], 0.0
        while len(apexes) < 3:
            sim.step()
            if before > 0 >= sim.qvel[2]:
                apexes.append(sim.qpos[2] - RADIUS)
            before = sim.qvel[2]
        errors.append(np.abs(apexes - HEIGHT * 0.25 ** np.arange(1, 4)).max())
        assert errors[-1] < 2 * dt * np.sqrt(2 * GRAVITY * HEIGHT)
    assert errors[1] < errors[0]


def test_a_sphere_that_has_bounced_comes_to_rest():
    sim = dropped(0.5, 2e-3)
    sim.step(nstep=5000)
    assert np.abs(sim.qvel).max() < 1e-12
    assert abs(sim.qpos[2] - RADIUS) <= sim.options.slop


def _thrown(geoms: list[str], dt: float, seed: int = 0) -> stepper.Stepper:
    """Sixteen environments of elastic bodies without friction, thrown at random above a floor."""
    bodies = "".join(f'<body pos="{0.5 * i} 0 1"><freejoint/><geom {geom} mass="{1 + i}"/></body>' for i, geom in enumerate(geoms))
    floor = '<mujoco><default><geom condim="1"/></default><worldbody><geom type="plane" size="5 5 1"/>'
    model = stepper.load(floor + bodies + "</worldbody></mujoco>")
    model = model.replace(geom_restitution=np.ones(model.ngeom))
    sim, rng = stepper.Stepper(model, 16, options=stepper.Options(timestep=dt)), np.random.default_rng(seed)
    sim.set_state(qvel=rng.normal(size=(16, model.nv)))
    return sim


def _energies(sim: stepper.Stepper) -> np.ndarray:
    return np.sum(sim.energy(), axis=0)


def test_colliding_elastic_spheres_keep_their_energy():
    """Newton's law for all closed contacts at once: the work of the impulses, lambda (v+ + v-) / 2, is zero contact by contact."""
    sim = _thrown(['size=".1"'] * 4, 2e-3)
    before = _energies(sim)
    sim.step(nstep=5000)
    # What touches slower than the threshold of 0.01 m/s rests instead: such grazes are rare, and take up to m v^2 / 2 = 2e-4 J of 40 J.
    np.testing.assert_allclose(_energies(sim), before, rtol=5e-6)


def test_an_elastic_box_that_strikes_with_its_corners_loses_nothing_but_the_order_of_the_step():
    """Between bounces the midpoint rule's energy is off by its order, and where spin and impulse meet by the first."""
    errors = []
    for dt in (4e-3, 5e-4):
        sim = _thrown(['type="box" size=".2 .15 .1"'], dt)
        before = _energies(sim)
        sim.step(nstep=round(4 / dt))
        errors.append(np.abs(_energies(sim) / before - 1).mean())
    assert errors[1] < 0.25 * errors[0] < 0.01
