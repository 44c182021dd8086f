"""Steps of the integrator `euler` against MuJoCo's Euler, where both are the same mathematics: motion without contact.

MuJoCo takes joints' damping implicitly, `eulerdamp="disable"` takes it explicitly.
"""

import mujoco
import numpy as np
import pytest
from models import SOURCES, afloat, random_state, simulate

ROBOTS = ["gymnasium/humanoid", "gymnasium/half_cheetah", "dm_control/walker", "dm_control/quadruped"]
STEPS = 20


@pytest.mark.parametrize("explicit", [False, True], ids=["eulerdamp", "no eulerdamp"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_damping_is_as_implicit_as_the_flag_says(robot, explicit):
    """Twenty steps of a robot that floats, under a control: as with MuJoCo to rounding, and otherwise than with the flag turned around."""
    model = afloat(robot)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_EULER, 1e-3
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS) | int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) * explicit
    rng = np.random.default_rng(0)
    qpos, qvel = random_state(model, rng, speed=1.0)
    ctrl = rng.uniform(-0.3, 0.3, model.nu)
    sim = simulate(model, integrator="euler", timestep=1e-3)
    sim.set_state(qpos, qvel)
    sim.step(ctrl, nstep=STEPS)
    ends = []
    for flags in (model.opt.disableflags, model.opt.disableflags ^ int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)):
        model.opt.disableflags = flags
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_step(model, data, STEPS)
        ends.append(data.qvel.copy())
    scale = np.abs(ends[0]).max()
    # Rounding, 1e-16, times the condition of the mass matrix, up to 1e4, in each of twenty steps.
    assert np.abs(sim.qvel - ends[0]).max() < 1e-10 * scale
    assert np.abs(sim.qvel - ends[1]).max() > 1e-6 * scale


def test_other_integrators_know_no_explicit_damping():
    """It holds for Euler's rule alone; the others stay stable with a damper that turns the motion around if it is explicit."""
    text = """<mujoco><option gravity="0 0 0"><flag eulerdamp="disable"/></option><worldbody><body>
      <joint type="slide" axis="1 0 0" damping="1e4"/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""
    for integrator in ("midpoint", "implicit"):
        sim = simulate(text, integrator=integrator)
        sim.set_state(qvel=[1.0])
        sim.step(nstep=20)
        assert abs(sim.qvel[0]) < 1e-6


def apart(model: mujoco.MjModel, controls: np.ndarray) -> float:
    """Largest difference of a velocity in steps of Euler's rule."""
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data = mujoco.MjData(model)
    sim = simulate(model, integrator="euler", timestep=model.opt.timestep)
    found = []
    for ctrl in controls:
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        sim.step(ctrl)
        found.append(np.abs(sim.qvel - data.qvel).max())
    return max(found)


@pytest.mark.parametrize("timestep", [4e-3, 1e-3])
def test_springs_of_fixed_tendons_are_implicit(timestep):
    """dm_control's fish swims in a medium with a spring between its fins; here springs of tendons are implicit with every integrator.

    Without that spring every step is MuJoCo's to rounding, medium and all. With it the difference of a step is that of an implicit spring,
    k x (1 - 1 / (1 + h^2 k / m)), and falls with the third power of the step, or the square of it where the spring is resolved.
    """
    model = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/fish"]))
    model.opt.timestep = timestep
    controls = np.tile(np.random.default_rng(0).uniform(-1, 1, model.nu), (100, 1))
    with_spring = apart(model, controls)
    model.tendon_stiffness[:] = 0
    without = apart(model, controls)
    # Velocities are of the order of 1 to 5; rounding times the condition of the mass matrix.
    assert without < 1e-11
    assert with_spring > 1e-6
