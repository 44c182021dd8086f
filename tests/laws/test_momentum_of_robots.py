"""Scene 10: a robot floats in space and moves its limbs.

Right answer: internal torques change neither linear nor angular momentum. In SimBenchmark the squared error of the linear momentum at a
step of 1 ms is 1.1e-3 (kg m/s)^2 for MuJoCo's Euler rule, 4.7e-5 for RaiSim and 3e-13 for MuJoCo's RK4. Orders of the drift:
laws/test_conservation.py.
"""

import numpy as np
import pytest
from models import afloat, simulate

ROBOT = "dm_control/humanoid"


@pytest.mark.parametrize(("integrator", "bound"), [("euler", 1.1e-3), ("midpoint", 4.7e-5), ("rk4", 3e-13)])
def test_momentum_after_ten_seconds_of_swimming(integrator, bound):
    """Every joint swings; each rule stays below the peer's square error that scenes.md gives for its class."""
    model = afloat(ROBOT, gravity=False)
    sim, rng = simulate(model, timestep=1e-3, integrator=integrator), np.random.default_rng(2)
    phase, swing, farthest = rng.uniform(0, 2 * np.pi, model.nu), 0.05, 0.0
    for k in range(250):
        sim.step(swing * np.sin(phase + 0.3 * k), nstep=40)
        farthest = max(farthest, np.abs(sim.qpos[7:]).max())
    assert farthest > 1.0  # rad: it moved.
    linear, angular = sim.momentum()
    assert linear @ linear < bound
    assert angular @ angular < bound  # kg m^2/s, about its own centre: limbs of about a metre.
