"""Scene 8: a free body with three unequal inertias, spun about its middle axis (Dzhanibekov).

Right answer: energy and angular momentum are constant, and the angular velocity is Jacobi's elliptic functions of time (Landau & Lifshitz,
Mechanics, section 37), so the flips are periodic. Explicit gyroscopic terms gain energy until they blow up.
"""

import numpy as np
import pytest
from atlas.scenes.flight import ENERGY, I1, I2, I3, L2, PERIOD, SPIN, TOUCH, omega
from models import simulate
from numerics import slope

BODY = f"""<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>
  <inertial pos="0 0 0" mass="1" diaginertia="{I1} {I2} {I3}"/></body></worldbody></mujoco>"""


def spun(dt: float, integrator: str, seconds: float):
    sim = simulate(BODY, timestep=dt, integrator=integrator)
    sim.set_state(qvel=[0, 0, 0, 0, SPIN, TOUCH])
    sim.step(nstep=round(seconds / dt))
    return sim


def test_the_closed_form_starts_where_the_body_starts():
    """And flips: after half a period the middle axis has turned over."""
    assert omega(0) == pytest.approx([0, SPIN, TOUCH], abs=1e-12)
    assert omega(PERIOD / 2) == pytest.approx([0, -SPIN, TOUCH], abs=1e-10)


def test_two_flips_are_jacobis():
    """Within 1e-9 of SPIN at every tenth of a period, by a rule of fourth order whose local error (omega h)^5 is 3e-12 a step of 1 ms."""
    sim = simulate(BODY, timestep=PERIOD / 5000, integrator="rk4")
    sim.set_state(qvel=[0, 0, 0, 0, SPIN, TOUCH])
    for k in range(1, 11):
        sim.step(nstep=500)
        assert sim.qvel[3:] == pytest.approx(omega(k * PERIOD / 10), abs=1e-9 * SPIN)


@pytest.mark.parametrize(("integrator", "order", "steps"), [("euler", 1, [4, 2, 1]), ("implicit", 1, [4, 2, 1]), ("rk4", 4, [32, 16, 8])])
def test_energy_and_angular_momentum_are_kept_to_the_order_of_the_rule(integrator, order, steps):
    """Over a whole period, from steps of so many thousandths of a quarter second."""
    dts = [PERIOD / round(PERIOD / (0.25e-3 * n)) for n in steps]
    energies, spins = [], []
    for dt in dts:
        sim = spun(dt, integrator, PERIOD)
        energies.append(abs(sum(sim.energy()) - ENERGY) / ENERGY)
        spins.append(np.linalg.norm(sim.momentum()[1] - [0, I2 * SPIN, I3 * TOUCH]) / np.sqrt(L2))
    assert slope(dts, energies) > order - 0.2
    assert slope(dts, spins) > order - 0.2


OFF_CENTRE = """<mujoco><option gravity="0 0 0"/><worldbody><body pos="0 0 1"><joint type="{kind}" {anchor}/>
  <inertial pos=".05 .02 -.1" mass="1" diaginertia=".01 .02 .026" euler="10 20 30"/></body></worldbody></mujoco>"""
SINGLE = {
    "centred": BODY,
    "off centre": OFF_CENTRE.format(kind="free", anchor=""),
    "ball": OFF_CENTRE.format(kind="ball", anchor='pos=".1 0 .05"'),
}


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("body", SINGLE)
def test_the_midpoint_rule_keeps_momentum_exactly_and_energy_without_drift(body, dt):
    """Over a hundred periods, or as long.

    A step leaves rounding and what eight iterations leave, (h omega / 2)^8 of 1e-4, in the momentum; energy swings by
    (h omega)^2 of it, and as much in the second half of the time as in the first.
    """
    sim = simulate(SINGLE[body], timestep=dt, integrator="midpoint")
    sim.set_state(qvel=np.array([0.3, 0.1, -0.2, 0, SPIN, TOUCH])[-sim.model.nv :])
    linear, angular = sim.momentum()
    start, swings = sum(sim.energy()), []
    for _ in range(1200):
        sim.step(nstep=round(PERIOD / 12 / dt))
        swings.append(abs(sum(sim.energy()) / start - 1))
        if body != "ball":
            assert np.abs(sim.momentum()[0] - linear).max() < 1e-11
            assert np.abs(sim.momentum()[1] - angular).max() < 1e-10 * np.linalg.norm(angular)
    assert max(swings) < (dt * SPIN) ** 2
    assert max(swings[600:]) < 2 * max(swings[:600]) + 1e-11


# Not Euler's rule, whose gyroscopic term is explicit: its energy grows as exp(c h t), which is its first order.
@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
def test_runge_and_kuttas_rule_does_not_blow_up_in_a_hundred_periods(dt):
    """A user's largest step, 0.1 rad of spin each: the body still tumbles with the energy that it had, to a tenth."""
    assert sum(spun(dt, "rk4", 100 * PERIOD).energy()) == pytest.approx(ENERGY, rel=0.1)
