"""Contact-free motion against a converged reference and against MuJoCo, and the orders of convergence.

The reference is DOP853 at tolerance 1e-13 on MuJoCo's accelerations with dq/dt = q (0, omega) / 2: it shares nothing with the engine. MuJoCo's
own RK4 adds the angular velocities of its four stages as if they belonged to one tangent space; without the terms of dexp^-1 it is of second
order where orientations and angular accelerations are not parallel. Measured below: that, not the engine, is what bounds the
agreement of tumbling bodies at dt 1e-4.
"""

import functools

import mujoco
import numpy as np
import pytest
from models import afloat, random_quaternion, simulate
from numerics import reference, slope, state_error

HEAD = '<mujoco><option timestep="1e-4" integrator="RK4"/><default><geom contype="0" conaffinity="0" density="1000"/></default><worldbody>'
TAIL = "</worldbody></mujoco>"


def chain(axes, length: float = 0.5) -> str:
    """Links of a hanging chain, one hinge each, without damping."""
    text = HEAD
    for k, axis in enumerate(axes):
        drop = f"0 0 {-length if k else 0}"
        text += f'<body pos="{drop}"><joint axis="{axis}"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 {-length}"/>'
    return text + "</body>" * len(axes) + TAIL


TEXTS = {
    "double pendulum": chain(["0 1 0"] * 2),
    "5-link chain": chain(["0 1 0", "1 0 0", "0 1 0", "1 0 1", "0 1 0"]),
    "tumbling body": HEAD + '<body><freejoint/><geom type="box" size=".1 .2 .3" pos=".05 0 0"/></body>' + TAIL,
}
SCENES = [*TEXTS, "humanoid"]


@functools.cache
def scene(name: str):
    """Model, start and a constant control."""
    rng = np.random.default_rng(7)
    model = mujoco.MjModel.from_xml_string(TEXTS[name]) if name in TEXTS else afloat("dm_control/humanoid")
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    qpos, qvel = model.qpos0.copy(), rng.normal(scale=1.0, size=model.nv)
    if name == "tumbling body":
        qpos[3:] = random_quaternion(rng)
        qvel[3:] = [1.0, 4.0, 2.0]
    elif name == "humanoid":
        qvel[3:6] = [0.5, 2.0, 1.0]
    else:
        qpos[:] = rng.uniform(-1, 1, model.nq)
    return model, qpos, qvel, rng.uniform(-0.5, 0.5, model.nu)


@functools.cache
def converged(name: str, seconds: float):
    model, qpos, qvel, ctrl = scene(name)
    return reference(model, qpos, qvel, seconds, ctrl)


def run(name: str, seconds: float, **options):
    """The engine's state after so many seconds; nothing may have touched."""
    model, qpos, qvel, ctrl = scene(name)
    sim = simulate(model, **options)
    sim.set_state(qpos, qvel)
    sim.step(ctrl, nstep=round(seconds / options["timestep"]))
    assert len(sim.contacts()) == 0
    assert sim.status == 0
    return sim.qpos, sim.qvel


def run_mujoco(name: str, timestep: float):
    """MuJoCo's RK4 after one second."""
    model, qpos, qvel, ctrl = scene(name)
    model = mujoco.MjModel.__copy__(model)
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_step(model, data, nstep=round(1.0 / timestep))
    return data.qpos, data.qvel


@pytest.mark.parametrize("name", SCENES)
def test_one_second_of_rk4_is_the_converged_motion(name):
    """1e-8 is the bound of issue 2."""
    assert state_error(scene(name)[0], run(name, 1.0, integrator="rk4", timestep=1e-4), converged(name, 1.0)) < 1e-8


@pytest.mark.parametrize("name", list(TEXTS)[:2])
def test_one_second_of_rk4_is_mujocos(name):
    """Both at dt 1e-4, where joints are scalars and both methods are the same tableau: 1e-8 is the bound of issue 2."""
    assert state_error(scene(name)[0], run(name, 1.0, integrator="rk4", timestep=1e-4), run_mujoco(name, 1e-4)) < 1e-8


@pytest.mark.parametrize("name", SCENES[2:])
def test_mujocos_rk4_is_what_bounds_the_agreement_of_tumbling_bodies(name):
    """The distance to MuJoCo at dt 1e-4 is MuJoCo's own error, which falls with the second order only."""
    model = scene(name)[0]
    steps = [1e-3, 5e-4, 2.5e-4]
    errors = [state_error(model, run_mujoco(name, dt), converged(name, 1.0)) for dt in steps]
    # Between the orders 1 and 3: half of an order either way is the noise of three points.
    assert 1.5 < slope(steps, errors) < 2.5
    theirs = run_mujoco(name, 1e-4)
    between = state_error(model, run(name, 1.0, integrator="rk4", timestep=1e-4), theirs)
    own = state_error(model, theirs, converged(name, 1.0))
    # Two numbers that differ by our error, which is below 1e-8 by the test above.
    assert abs(between - own) < 1e-8


ORDERS = {"euler": (1, [4e-4, 2e-4, 1e-4]), "midpoint": (2, [2e-3, 1e-3, 5e-4]), "rk4": (4, [8e-3, 4e-3, 2e-3])}


@pytest.mark.parametrize("integrator", ORDERS)
@pytest.mark.parametrize("name", SCENES)
def test_order_of_convergence(name, integrator):
    """The humanoid has springs, dampers and a constant control.

    Between 0.2 of the order: the next term of the error is h times smaller or larger, which bends a line over a factor of 4 in h by less,
    while the next order is 1 away.
    """
    order, steps = ORDERS[integrator]
    errors = [state_error(scene(name)[0], run(name, 0.4, integrator=integrator, timestep=dt), converged(name, 0.4)) for dt in steps]
    assert abs(slope(steps, errors) - order) < 0.2
