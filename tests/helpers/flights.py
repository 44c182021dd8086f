"""Contact-free scenes with their converged motion: pendulums without damping, a tumbling body, a floating humanoid."""

import functools

import mujoco
import numpy as np
from models import afloat, random_quaternion, simulate
from numerics import reference

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
