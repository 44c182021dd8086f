"""Equalities of every kind against one step of the same mathematics in NumPy, with MuJoCo's mass matrix, forces and Jacobians."""

import mujoco
import numpy as np
import pytest
import stepper
from contact_problem import equalities
from equalities import KINDS, LINKAGE, rows_of
from models import forward, full_mass_matrix, random_state, simulate


@pytest.mark.parametrize("h", [1e-3, 1e-2])
@pytest.mark.parametrize("kind", KINDS)
def test_one_step_is_numpys(kind, h):
    """Euler's rule from random states, with whatever error they have: M (v+ - v) = h f + J^T lambda with J v+ as demanded."""
    source = LINKAGE.format(equality=KINDS[kind])
    model, rng = mujoco.MjModel.from_xml_string(source), np.random.default_rng(3)
    sim = simulate(source, integrator="euler", timestep=h, stabilization="baumgarte")
    for _ in range(10):
        qpos, qvel = random_state(model, rng, speed=1.0)
        data = forward(model, qpos, qvel)
        sim.set_state(qpos, qvel)
        sim.step()
        mass = full_mass_matrix(model, data) + h * np.diag(model.dof_damping)
        free = qvel + h * np.linalg.solve(mass, data.qfrc_passive - data.qfrc_bias)
        rows, asked = equalities(model, data, mass, qvel, sim.options, midpoint=False)
        response = np.linalg.solve(mass, rows.T)
        expected = free + response @ np.linalg.solve(rows @ response, asked - rows @ free)
        scale = np.sqrt(expected @ mass @ expected)
        error = sim.qvel - expected
        # Rounding, times the condition of the rows in the metric of M (1e5 at the most here).
        assert np.sqrt(error @ mass @ error) < 1e-10 * scale
        assert sim.residual < 1e-10
        # Random states do not meet the equalities, and one step does not close them.
        assert int(sim.status) & ~stepper.Status.EQUALITY_VIOLATED == stepper.Status.OK


@pytest.mark.parametrize("kind", KINDS)
def test_errors_go_to_zero_and_stay_there(kind):
    """From reset, where some are torn by a metre, in motion that dampers bring to rest."""
    source = LINKAGE.format(equality=KINDS[kind])
    model = mujoco.MjModel.from_xml_string(source)
    model.dof_damping[:] = 4.0
    model.opt.gravity[:] = 0
    for integrator in ("euler", "midpoint"):
        for stabilization in ("baumgarte", "split"):
            sim = simulate(model, integrator=integrator, stabilization=stabilization, timestep=5e-3)
            sim.set_state(qvel=np.random.default_rng(5).normal(scale=0.1, size=model.nv))
            sim.step(nstep=4000)
            rows = rows_of(model, forward(model, sim.qpos, sim.qvel))
            assert np.abs(rows.error).max() < 1e-9
            assert np.abs(sim.qvel).max() < 1e-6
