"""Elastic impacts of bodies that turn are of second order: a flight ends at the time of the impact, and velocities jump there."""

import numpy as np
import pytest
import stepper
from models import simulate
from stepper import Status

BOX = '<body pos="0 0 1"><freejoint/><geom type="box" size=".1 .15 .2" mass="1"/></body>'
FLOOR = '<geom type="plane" size="9 9 1"/>'
ENVS = 64


def boxes(timestep: float, *, bodies: int = 1, restitution: float = 1.0, num_envs: int = ENVS, **options) -> stepper.Stepper:
    """Boxes that turn at 5 rad/s about random axes, and fall on a plane without friction."""
    text = "".join(BOX.replace("0 0 1", f"{k} 0 1") for k in range(bodies))
    model = stepper.load(f'<mujoco><default><geom condim="1" friction="0"/></default><worldbody>{FLOOR}{text}</worldbody></mujoco>')
    sim = simulate(model.replace(geom_restitution=np.full(model.ngeom, restitution)), num_envs, timestep=timestep, **options)
    rng = np.random.default_rng(0)
    qpos, qvel = sim.qpos.copy(), rng.normal(size=sim.qvel.shape) * np.tile([1, 1, 1, 5, 5, 5], bodies)
    qpos[:, 2::7] = rng.uniform(0.5, 1.5, qpos[:, 2::7].shape)
    sim.set_state(qpos=qpos, qvel=qvel)
    return sim


def energy_error(sim: stepper.Stepper, seconds: float = 2.0) -> np.ndarray:
    """Largest deviation of the energy of each environment from its first value, as a fraction of it."""
    start, error = np.sum(sim.energy(), axis=0), np.zeros(sim.num_envs)
    for _ in range(round(seconds / sim.timestep)):
        sim.step()
        assert not (sim.status & ~Status.OK).any()
        error = np.maximum(error, np.abs(np.sum(sim.energy(), axis=0) / start - 1))
    return error


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize(("timestep", "most"), [(2e-3, 1e-4), (1e-2, 1e-3)])
def test_the_energy_of_tumbling_elastic_boxes_is_constant(timestep, most, precision):
    """One impulse for the whole step gives 4e-3 and 2e-2; measured 1e-5 and 2.2e-4."""
    assert np.median(energy_error(boxes(timestep, precision=precision))) < most


def test_the_energy_is_of_second_order():
    """From 10 ms to 2.5 ms the error falls to a sixteenth. Between two steps, other impacts happen: 1.7 of 2 orders are asked for."""
    coarse, fine = (np.median(energy_error(boxes(timestep))) for timestep in (1e-2, 2.5e-3))
    assert coarse / fine > 4**1.7


@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "rk4"])
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_parts_of_a_step_depend_on_no_neighbour(integrator, precision):
    """Environments of a batch divide their steps at other times, and have the bits of an environment of their own."""
    settings = {"integrator": integrator, "precision": precision, "restitution": 0.7}
    batch = boxes(5e-3, num_envs=9, **settings)
    qpos, qvel = batch.qpos.copy(), batch.qvel.copy()
    alone = [boxes(5e-3, num_envs=1, **settings) for _ in range(9)]
    for env, sim in enumerate(alone):
        sim.set_state(qpos=qpos[env : env + 1], qvel=qvel[env : env + 1])
    divided = 0
    for _ in range(200):
        batch.step()
        divided += np.unique(batch.substeps).size > 1
        for env, sim in enumerate(alone):
            sim.step()
            np.testing.assert_array_equal(sim.qpos[0], batch.qpos[env])
            np.testing.assert_array_equal(sim.qvel[0], batch.qvel[env])
            assert (sim.substeps[0], sim.status[0]) == (batch.substeps[env], batch.status[env])
            assert sim.contacts(0)["force"].tobytes() == batch.contacts(env)["force"].tobytes()
    assert divided > 20


def test_the_impulses_of_the_parts_are_summed():
    """The momentum that a step gains is the sum of the contact impulses, and of gravity."""
    sim = boxes(1e-2, num_envs=8)
    divided = 0
    for _ in range(100):
        before = sim.qvel[:, 2].copy()
        sim.step()
        divided += int((sim.substeps > 0).sum())
        for env in range(8):
            force = sum(contact["force"][0] for contact in sim.contacts(env))
            # Rounding of a momentum of 10 kg m/s.
            assert sim.qvel[env, 2] - before[env] == pytest.approx((force - 9.81) * 1e-2, abs=1e-12)
    assert divided > 10


def test_a_ball_comes_to_rest_and_its_steps_are_whole_again():
    """Bounces shorter than a step rest: the number of parts of a step is bounded."""
    model = stepper.load(f'<mujoco><worldbody>{FLOOR}<body pos="0 0 .5"><freejoint/><geom size=".1"/></body></worldbody></mujoco>')
    sim = simulate(model.replace(geom_restitution=np.full(model.ngeom, 0.8)), timestep=5e-3)
    most = 0
    for _ in range(2000):
        sim.step()
        most = max(most, int(sim.substeps))
    assert 3 <= most <= 5
    assert sim.substeps == 0
    assert abs(sim.qvel).max() < 1e-9


@pytest.mark.parametrize("error", [1e-3, 1e-5])
def test_steps_that_keep_an_error_end_with_impacts(error):
    """Impacts divide the intervals of step doubling. The energy error of boxes falls with the error that is asked for."""
    sim = boxes(1e-2, num_envs=8, error=error)
    assert np.median(energy_error(sim, 1.0)) < 10 * error
    assert (sim.substeps > 0).all()


def test_a_bounce_beside_a_resting_stack_changes_nothing_of_it():
    """Mechanisms that no impact touches keep their whole step, contacts and impulses included."""
    stack = "".join(f'<body pos="3 0 {0.1 + 0.2 * k}"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>' for k in range(3))
    ball = '<body pos="0 0 .3"><freejoint/><geom name="ball" size=".1" mass="1"/></body>'

    def world(text: str) -> stepper.Stepper:
        model = stepper.load(f"<mujoco><worldbody>{FLOOR}{text}</worldbody></mujoco>")
        restitution = np.array([*[0.0] * (model.ngeom - 1), float("ball" in text)])
        # The tolerance is relative to the speed of the fastest body, unless it is small.
        return simulate(model.replace(geom_restitution=restitution), timestep=5e-3, tolerance=1e-9)

    alone, beside = world(stack), world(stack + ball)
    for _ in range(200):
        alone.step()
        beside.step()
        # The solver stops at the same residual, on rows in another order.
        np.testing.assert_allclose(beside.qpos[:21], alone.qpos, atol=1e-8)
        forces = [sum(c["force"][0] for c in sim.contacts() if 2 < c["pos"][0] < 4 and c["pos"][2] < 0.05) for sim in (alone, beside)]
        np.testing.assert_allclose(forces, 3 * 9.81, atol=0.05)
