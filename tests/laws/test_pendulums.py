"""Scene 11: a double pendulum and a chain of five links, without damping.

Right answer: the energy is constant, and the state is that of a converged DOP853 solution. Here the time steps that a user may choose;
the state after one second at dt 1e-4 is held to 1e-8 in reference/test_trajectories.py.
"""

import pytest
from flights import converged, run, scene
from models import simulate
from numerics import slope, state_error

ORDERS = {"euler": 1, "midpoint": 2, "rk4": 4}
STEPS = [4e-3, 2e-3, 1e-3]

every_rule = pytest.mark.parametrize(("integrator", "order"), ORDERS.items())
every_pendulum = pytest.mark.parametrize("name", ["double pendulum", "5-link chain"])


def worst_energy_error(name: str, integrator: str, dt: float) -> float:
    """In two seconds of falling and swinging, looked at every 20 ms."""
    model, qpos, qvel, _ = scene(name)
    sim = simulate(model, integrator=integrator, timestep=dt)
    sim.set_state(qpos, qvel)
    start, worst = sum(sim.energy()), 0.0
    for _ in range(100):
        sim.step(nstep=round(0.02 / dt))
        worst = max(worst, abs(sum(sim.energy()) - start))
    return worst


@every_rule
@every_pendulum
def test_energy_is_constant_to_the_order_of_the_rule(name, integrator, order):
    """Within 0.2 of the order or better, as in test_order_of_convergence."""
    assert slope(STEPS, [worst_energy_error(name, integrator, dt) for dt in STEPS]) > order - 0.2


@every_rule
@every_pendulum
def test_the_state_converges_to_the_reference(name, integrator, order):
    """After a whole second, in which the motion of the chain multiplies errors about a hundredfold: 0.3 for coarse steps' higher terms."""
    errors = [state_error(scene(name)[0], run(name, 1.0, integrator, dt), converged(name, 1.0)) for dt in STEPS]
    assert slope(STEPS, errors) == pytest.approx(order, abs=0.3)
