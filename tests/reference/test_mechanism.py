"""A mechanism of every joint, actuator and activation kind against MuJoCo's Euler, step for step."""

import mujoco
import numpy as np
import pytest
import stepper

MECHANISM = """<mujoco><option timestep="0.002" integrator="Euler"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body pos="0 0 1">
    <joint name="slide" type="slide" axis="1 0 0" damping="2" stiffness="10" springref=".1"/>
    <joint name="hinge" type="hinge" axis="0 1 .3" pos="0 .02 .1" armature=".1" stiffness="3" damping=".2"/>
    <geom type="capsule" size=".05 .2"/>
    <body pos=".3 0 0" euler="10 20 30"><joint type="ball" damping=".1" stiffness="2"/><geom type="box" size=".1 .05 .2" pos=".1 0 0"/>
      <body pos="0 .3 0"><joint name="yaw" axis="0 0 1" ref=".2"/><joint name="roll" axis="1 0 0"/>
        <geom type="ellipsoid" size=".1 .05 .03"/>
      </body></body></body></worldbody>
  <tendon><fixed name="tendon"><joint joint="hinge" coef="1.5"/><joint joint="yaw" coef="-.7"/></fixed></tendon>
  <actuator>
    <motor joint="slide" gear="20" ctrlrange="-1 1"/>
    <position joint="hinge" kp="30" kv="1" forcerange="-5 5"/>
    <velocity joint="yaw" kv=".5"/>
    <general tendon="tendon" gear="2" dyntype="filter" dynprm=".05" gainprm="3" biastype="affine" biasprm=".1 -.5 -.05"/>
    <general joint="roll" dyntype="integrator" gainprm="1" actlimited="true" actrange="-.2 .2"/>
    <general joint="roll" dyntype="filterexact" dynprm=".03" gainprm="0.3"/>
  </actuator></mujoco>"""


def test_euler_is_mujocos():
    """The mathematics is the same, joint damping implicit in both: what differs is rounding, times some 1e3 by chaos in 0.6 s."""
    model = mujoco.MjModel.from_xml_string(MECHANISM)
    data = mujoco.MjData(model)
    sim = stepper.Stepper(stepper.load(model), options=stepper.Options(integrator="euler"))
    rng = np.random.default_rng(0)
    for _ in range(6):
        data.ctrl[:] = rng.uniform(-1.5, 1.5, model.nu)
        mujoco.mj_step(model, data, 50)
        sim.step(data.ctrl, nstep=50)
    assert np.abs(data.qpos).max() > 0.3
    assert sim.qpos == pytest.approx(data.qpos, abs=1e-10)
    assert sim.qvel == pytest.approx(data.qvel, abs=1e-9)
    assert sim.act == pytest.approx(data.act, abs=1e-12)
