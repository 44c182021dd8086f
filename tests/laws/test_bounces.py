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


@pytest.mark.parametrize("speed", [5, 15, 30])
def test_an_overlap_elsewhere_takes_no_rebound_away(speed):
    """Baumgarte's bias of the box is no reason to solve the bounce of the ball without its rebound (Euler's rule: both in one solve)."""

    def fastest(more: str) -> float:
        model = stepper.load(
            f"""<mujoco><option timestep=".005"/><worldbody><geom type="plane" size="9 9 1"/>
            <body pos="0 0 .3"><freejoint/><geom size=".1"/></body>{more}</worldbody></mujoco>"""
        )
        restitution = np.zeros(model.ngeom)
        restitution[1] = 0.8
        options = stepper.Options(integrator="euler", stabilization="baumgarte")
        sim = stepper.Stepper(model.replace(geom_restitution=restitution), options=options)
        sim.set_state(qvel=[0, 0, -speed, *[0] * (model.nv - 3)])
        up = []
        for _ in range(30):
            sim.step()
            up.append(sim.qvel[2])
        return max(up)

    box = '<body pos="3 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    # The solver's tolerance is at most 1e-4 m/s.
    assert fastest(box) == pytest.approx(fastest(""), abs=1e-3)
