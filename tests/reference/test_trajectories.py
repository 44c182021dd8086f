"""Contact-free motion against a converged reference and against MuJoCo, and the orders of convergence.

The reference is DOP853 at tolerance 1e-13 on MuJoCo's accelerations with dq/dt = q (0, omega) / 2: it shares nothing with the engine.
"""

import copy
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
    qpos, qvel = model.qpos0.copy(), rng.normal(scale=0.3, size=model.nv)
    if name == "tumbling body":
        qpos[3:] = random_quaternion(rng)
        qvel[3:] = [1.0, 4.0, 2.0]
    elif name == "humanoid":
        qvel[3:6] = [0.3, 1.0, 0.5]
    else:
        qpos[:] = rng.uniform(-1, 1, model.nq)
    return model, qpos, qvel, rng.uniform(-0.1, 0.1, model.nu)


@functools.cache
def converged(name: str, seconds: float):
    """The reference's state after so many seconds."""
    model, qpos, qvel, ctrl = scene(name)
    return reference(model, qpos, qvel, seconds, ctrl)


@functools.cache
def run(name: str, seconds: float, integrator: str, timestep: float):
    """The engine's state after so many seconds; nothing may have touched."""
    model, qpos, qvel, ctrl = scene(name)
    sim = simulate(model, integrator=integrator, timestep=timestep)
    sim.set_state(qpos, qvel)
    sim.step(ctrl, nstep=round(seconds / timestep))
    assert len(sim.contacts()) == 0
    assert sim.status == 0
    return sim.qpos, sim.qvel


def run_mujoco(name: str, timestep: float):
    """MuJoCo's RK4 after one second."""
    model, qpos, qvel, ctrl = scene(name)
    model = copy.copy(model)
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_step(model, data, nstep=round(1.0 / timestep))
    return data.qpos, data.qvel


BOUND = 1e-8  # Of issue 2. Measured: 2e-13 to 3e-12 from the reference, 3e-15 to 5e-14 from MuJoCo.


@pytest.mark.parametrize("name", SCENES)
def test_one_second_of_rk4_is_the_converged_motion(name):
    assert state_error(scene(name)[0], run(name, 1.0, "rk4", 1e-4), converged(name, 1.0)) < BOUND


@pytest.mark.parametrize("name", SCENES)
def test_one_second_of_rk4_is_mujocos(name):
    """Both at dt 1e-4; bodies that tumble too, because MuJoCo 4's RK4 is of fourth order on quaternions."""
    assert state_error(scene(name)[0], run(name, 1.0, "rk4", 1e-4), run_mujoco(name, 1e-4)) < BOUND


STEPS = {"euler": (1, [4e-4, 2e-4, 1e-4]), "midpoint": (2, [2e-3, 1e-3, 5e-4]), "rk4": (4, [8e-3, 4e-3, 2e-3])}
STIFF = {("humanoid", "rk4"): [2e-3, 1e-3, 5e-4]}
"""Where damping over armature gives rates of 200/s, steps must be shorter than 5 ms for the order to show."""


@pytest.mark.parametrize("integrator", STEPS)
@pytest.mark.parametrize("name", SCENES)
def test_order_of_convergence(name, integrator):
    """The humanoid has springs, dampers and a constant control.

    Within 0.2 of the order: the next term of the error is h times a rate of the motion smaller, which bends a line over a factor of 4 in h
    by a tenth, while the next order is 1 away.
    """
    order, steps = STEPS[integrator]
    steps = STIFF.get((name, integrator), steps)
    errors = [state_error(scene(name)[0], run(name, 0.4, integrator, dt), converged(name, 0.4)) for dt in steps]
    assert abs(slope(steps, errors) - order) < 0.2
