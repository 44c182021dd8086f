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


def apart(model: mujoco.MjModel, steps: int, controls) -> tuple[float, float]:
    """Largest difference of a velocity in the first step, and in all steps of Euler's rule."""
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data = mujoco.MjData(model)
    sim = simulate(model, integrator="euler", timestep=model.opt.timestep)
    found = []
    for k in range(steps):
        data.ctrl[:] = controls[k]
        mujoco.mj_step(model, data)
        sim.step(controls[k])
        found.append(np.abs(sim.qvel - data.qvel).max())
    return found[0], max(found)


@pytest.mark.parametrize("timestep", [4e-3, 1e-3])
def test_springs_of_fixed_tendons_are_implicit(timestep):
    """dm_control's fish swims in a medium with a spring between its fins; here springs of tendons are implicit with every integrator.

    Without that spring every step is MuJoCo's to rounding, medium and all. With it the difference of a step is that of an implicit spring,
    k x (1 - 1 / (1 + h^2 k / m)), and falls with the third power of the step, or the square of it where the spring is resolved.
    """
    model = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/fish"]))
    model.opt.timestep = timestep
    controls = np.tile(np.random.default_rng(0).uniform(-1, 1, model.nu), (100, 1))
    with_spring = apart(model, 100, controls)
    model.tendon_stiffness[:] = 0
    without = apart(model, 100, controls)
    # Velocities are of the order of 1 to 5; rounding times the condition of the mass matrix.
    assert without[1] < 1e-11
    assert with_spring[1] > 1e-6


def test_a_finger_coupled_by_a_tendon():
    """Robosuite's Jaco has fingers like this: two joints, a fixed tendon with a spring, dry friction and an equality, a bounded servo.

    What differs from MuJoCo is the tendon's spring, which is implicit, and constraints, which are hard; without them they are the same.
    """
    text = """<mujoco><option gravity="0 0 0"/><worldbody><body><inertial pos=".022 0 0" mass=".01" diaginertia="7.9e-7 7.9e-7 8e-8"/>
      <joint name="a" axis="1 0 0" ref="1.1" range="0 1.51" limited="true" damping=".15"/>
      <body pos="0 -.003 .044"><inertial pos=".022 0 0" mass=".01" diaginertia="7.9e-7 7.9e-7 8e-8"/>
        <joint name="b" axis="-1 0 0" ref="-.5" range="0 2" limited="true" damping=".1"/></body></body></worldbody>
      <tendon><fixed name="t" range="-5 5" stiffness="3" springlength=".2" frictionloss=".4"><joint joint="a" coef=".4"/><joint joint="b"
        coef="-.4"/></fixed></tendon><equality><tendon tendon1="t"/></equality>
      <actuator><position joint="a" kp="20" ctrlrange="0 1.51" forcerange="-.3 .3"/></actuator></mujoco>"""
    controls = np.full((100, 1), 0.7)
    model = mujoco.MjModel.from_xml_string(text)
    assert apart(model, 100, controls)[1] > 1e-3
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    assert apart(model, 100, controls)[1] > 1e-3
    model.tendon_stiffness[:] = 0
    assert apart(model, 100, controls)[1] < 1e-12


def test_a_delayed_control_begins_with_the_first_one():
    """MuJoCo's history of controls begins with zeros, a delay line here with the first control (docs/reference/actuators.md).

    That is all: if the first control is zero, every step is MuJoCo's, whatever follows.
    """
    text = """<mujoco><option timestep=".01"/><worldbody><body><joint name="slide" type="slide"/><geom size=".1"/></body></worldbody>
      <actuator><motor joint="slide" delay=".05" nsample="6"/></actuator></mujoco>"""
    controls = np.random.default_rng(0).uniform(-1, 1, (60, 1))
    model = mujoco.MjModel.from_xml_string(text)
    first, _ = apart(model, 60, controls)
    assert first == pytest.approx(0.01 * abs(controls[0, 0]) / model.body_mass[1], rel=1e-12)
    controls[0] = 0
    assert apart(model, 60, controls)[1] < 1e-14
