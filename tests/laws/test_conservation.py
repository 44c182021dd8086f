"""Momentum and energy of whole robots."""

import mujoco
import numpy as np
import pytest
from models import SOURCES, simulate
from numerics import slope

ORDERS = {"euler": (1, 4e-3), "midpoint": (2, 4e-3), "rk4": (4, 4e-3)}


def weightless(name: str, *, limits: bool) -> mujoco.MjModel:
    """A robot in space: its limits and the contacts among its limbs act (or do not), nothing outside does."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    model.opt.gravity[:] = 0
    model.qpos0[2] += 100
    if not limits:
        model.jnt_limited[:] = 0
        model.geom_contype[:] = 0
        model.geom_conaffinity[:] = 0
    return model


def drift(model: mujoco.MjModel, seconds: float, **options) -> np.ndarray:
    """Changes of linear and of angular momentum under random motor commands that change every 40 ms, relative to what goes around.

    The scale is the momentum that the limbs have by themselves: mass of the robot times 1 m/s, and times 1 m.
    """
    sim, rng = simulate(model, **options), np.random.default_rng(11)
    sim.set_state(qpos=model.qpos0, qvel=rng.normal(scale=0.5, size=model.nv))
    start = sim.momentum()
    for _ in range(round(seconds / 0.04)):
        sim.step(rng.uniform(-1, 1, model.nu), nstep=round(0.04 / options["timestep"]))
    return np.array([np.abs(b - a).max() for a, b in zip(start, sim.momentum(), strict=True)]) / model.body_mass.sum()


@pytest.mark.parametrize("integrator", ORDERS)
@pytest.mark.parametrize("name", ["dm_control/humanoid", "gymnasium/ant"])
def test_internal_torques_leave_momentum_alone(name, integrator):
    """What changes is the truncation error of the integrator, so it falls with its order."""
    order, coarse = ORDERS[integrator]
    model = weightless(name, limits=False)
    steps = [coarse, coarse / 2, coarse / 4]
    drifts = [drift(model, 0.4, integrator=integrator, timestep=dt).max() for dt in steps]
    assert slope(steps, drifts) > order - 0.3
