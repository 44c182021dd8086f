"""Robots dropped and left: at rest the floor carries their weight, nothing creeps, nothing sinks."""

import numpy as np
import pytest
from models import force_of_world, mujoco_model, random_quaternion, simulate, stepper_model

ENVS = 16
# s. The slowest is the ant: rotors of 1 kg m^2 on legs of 0.1 kg fold up with time constants of seconds (measured: 20 to 40 s).
SETTLE = 60.0
CREEP = 1e-9  # m/s and rad/s, of issue 2.


def dropped_humanoid(qpos, rng):
    """In any orientation: it falls over, because its standing pose is no stable one."""
    qpos[:, 3:7] = [random_quaternion(rng) for _ in qpos]


def dropped_ant(qpos, rng):
    """Tilted a little and with bent legs, off its symmetric pose, which is in equilibrium but unstable."""
    qpos[:, 4:7] += rng.normal(scale=0.1, size=(ENVS, 3))
    qpos[:, 7:] += rng.normal(scale=0.05, size=(ENVS, 8))


def dropped_quadruped(qpos, rng):
    """From up to 0.3 m above its feet. The ball that falls beside it must not be touched: it would roll for ever."""
    qpos[:, 2] += np.linspace(0, 0.3, ENVS)
    qpos[:, 30 - 7] += 5.0


ROBOTS = {"dm_control/humanoid": dropped_humanoid, "gymnasium/ant": dropped_ant, "dm_control/quadruped": dropped_quadruped}


@pytest.mark.parametrize("stabilization", ["baumgarte", "split"])
@pytest.mark.parametrize("integrator", ["euler", "midpoint", "rk4"])
@pytest.mark.parametrize("name", ROBOTS)
def test_at_rest(name, integrator, stabilization):
    sim = simulate(stepper_model(name, strict=name != "dm_control/quadruped"), ENVS, integrator=integrator, stabilization=stabilization)
    qpos = sim.qpos.copy()
    ROBOTS[name](qpos, np.random.default_rng(0))
    sim.set_state(qpos=qpos)
    sim.step(nstep=round(SETTLE / sim.timestep))
    rest = sim.qpos
    sim.step(nstep=round(1.0 / sim.timestep))
    assert (sim.status == 0).all()

    weight = 9.81 * mujoco_model(name).body_mass.sum()
    force = np.array([force_of_world(sim.contacts(env)) for env in range(ENVS)])
    assert force == pytest.approx(np.tile([0, 0, weight], (ENVS, 1)), abs=1e-6 * weight)  # Of issue 2.
    assert np.abs(sim.qvel).max() < CREEP
    assert np.abs(sim.qpos - rest).max() < CREEP * 1.0
    # What is beyond the slop shrinks by a fifth in every step, for ever.
    deepest = min(sim.contacts(env)["distance"].min() for env in range(ENVS))
    assert -deepest <= sim.options.slop * (1 + 1e-6)
