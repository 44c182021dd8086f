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
