"""A bounce of one sphere by Newton's law, v+ = -e v-; with e = 1 the energy is constant. Scenes 7 and 35 of the atlas have the apexes."""

import numpy as np
import pytest
import stepper

BALL = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 1"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("dt", [5e-4, 2e-3, 1e-2])
def test_an_elastic_sphere_keeps_its_energy_for_twenty_seconds(dt):
    model = stepper.load(BALL).replace(geom_restitution=[0.0, 1.0])  # A pair takes the larger.
    sim = stepper.Stepper(model, options=stepper.Options(timestep=dt, integrator="midpoint"))
    energy = sum(sim.energy())
    sim.step(nstep=round(20 / dt))
    # The midpoint rule reverses the velocity at an unchanged height: what is left is rounding, some 1e-16 a step.
    assert sum(sim.energy()) == pytest.approx(energy, rel=1e-11)


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
