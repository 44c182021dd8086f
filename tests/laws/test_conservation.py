"""Momentum of whole robots that only their own limbs touch."""

import mujoco
import numpy as np
import pytest
from models import SOURCES, afloat, simulate
from numerics import slope

ORDERS = {"euler": 1, "midpoint": 2, "rk4": 4}


def weightless(name: str, *, within: bool) -> mujoco.MjModel:
    """Robot in space, above the floor, whose limits and contacts among its limbs act; `within` moves its joints into their ranges."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    model.opt.gravity[:] = 0
    model.qpos0[2] += 100
    if within:
        low, high = model.jnt_range[1:].T
        model.qpos0[7:] = np.clip(model.qpos0[7:], low + 0.05, high - 0.05)
    return model


def drifts(model: mujoco.MjModel, steps, **options) -> list[float]:
    """Changes of linear and angular momentum (the larger, per kg) in 0.4 s for every step size, under commands that change every 40 ms."""
    found = []
    for dt in steps:
        sim, rng = simulate(model, timestep=dt, **options), np.random.default_rng(11)
        sim.set_state(qpos=model.qpos0, qvel=rng.normal(scale=0.5, size=model.nv))
        start = sim.momentum()
        for _ in range(10):
            sim.step(rng.uniform(-1, 1, model.nu), nstep=round(0.04 / dt))
        found.append(max(np.abs(b - a).max() for a, b in zip(start, sim.momentum(), strict=True)) / model.body_mass.sum())
    return found


@pytest.mark.parametrize("integrator", ORDERS)
@pytest.mark.parametrize("name", ["dm_control/humanoid", "gymnasium/ant"])
def test_internal_torques_leave_momentum_alone(name, integrator):
    """What changes is the truncation error of the rule, so it falls with its order: within 0.2, as in test_order_of_convergence."""
    steps = [1e-3, 5e-4, 2.5e-4]
    assert slope(steps, drifts(afloat(name, gravity=False), steps, integrator=integrator)) > ORDERS[integrator] - 0.2


@pytest.mark.parametrize(("within", "stabilization"), [(True, "split"), (False, "baumgarte")])
@pytest.mark.parametrize("integrator", ORDERS)
def test_limits_and_contacts_among_the_limbs_leave_momentum_alone(integrator, within, stabilization):
    """Impacts jump within a step, which leaves every rule the first order; half of it is what three samples of jumps are worth.

    The projection of "split" moves joints at unchanged joint velocities, and momentum is M(q) v. A robot that starts 0.5 rad outside its
    ranges, as the ant at qpos0, hence changes its momentum by that violation times its speed, whatever the time step.
    """
    steps, model = [4e-3, 2e-3, 1e-3], weightless("gymnasium/ant", within=within)
    assert slope(steps, drifts(model, steps, integrator=integrator, stabilization=stabilization)) > 0.5


@pytest.mark.parametrize(("integrator", "bound"), [("euler", 1.1e-3), ("midpoint", 4.7e-5), ("rk4", 3e-13)])
def test_momentum_after_ten_seconds_of_swimming(integrator, bound):
    """A robot in space whose joints swing keeps its momentum better than the peer of each rule in SimBenchmark.

    There the squared error of the linear momentum at a step of 1 ms is 1.1e-3 (kg m/s)^2 for MuJoCo's Euler rule, 4.7e-5 for RaiSim and
    3e-13 for MuJoCo's RK4.
    """
    model = afloat("dm_control/humanoid", gravity=False)
    sim, rng = simulate(model, timestep=1e-3, integrator=integrator), np.random.default_rng(2)
    phase, swing, farthest = rng.uniform(0, 2 * np.pi, model.nu), 0.05, 0.0
    for k in range(250):
        sim.step(swing * np.sin(phase + 0.3 * k), nstep=40)
        farthest = max(farthest, np.abs(sim.qpos[7:]).max())
    assert farthest > 1.0  # rad: it moved.
    linear, angular = sim.momentum()
    assert linear @ linear < bound
    assert angular @ angular < bound  # kg m^2/s, about its own centre: limbs of about a metre.
