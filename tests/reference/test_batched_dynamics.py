"""Quantities of all environments by name, mass matrices and inverse dynamics: MuJoCo's, in arrays of the caller's."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, full_mass_matrix, random_state, stepper_model
from stepper._quantities import KINDS

ENVS = 5
ROBOTS = ["gymnasium/ant", "gymnasium/humanoid", "gymnasium/pusher_v5", "dm_control/quadruped", "dm_control/fish", "dm_control/cheetah"]


def crowd(name, num_envs=ENVS, **settings):
    """Environments in random states, and the states."""
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    sim = stepper.Stepper(stepper_model(name), num_envs, **settings)
    rng = np.random.default_rng(3)
    q, v = (np.array(part) for part in zip(*(random_state(source, rng, 1.0) for _ in range(num_envs)), strict=True))
    sim.set_state(q, v)
    return source, sim, q, v, rng


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_matrices_and_inverse_dynamics_are_mujocos(name):
    source, sim, q, v, rng = crowd(name)
    source.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    sim.qfrc_applied[:], sim.xfrc_applied[:] = rng.normal(size=(ENVS, source.nv)), rng.normal(size=(ENVS, source.nbody, 6))
    qacc = rng.normal(size=(ENVS, source.nv))
    mass, bias, forces = sim.mass_matrix(), sim.qfrc_bias, sim.inverse_dynamics(qacc)
    half = stepper.Stepper(sim.model, ENVS, precision="f32")
    half.set_state(q, v)
    data = mujoco.MjData(source)
    for k in range(ENVS):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], qacc[k]
        mujoco.mj_inverse(source, data)
        expected = full_mass_matrix(source, data)
        size = np.abs(data.qfrc_inverse).max() + np.abs(expected).max()
        np.testing.assert_allclose(mass[k], expected, atol=1e-11 * size)
        # Sums of some tens of terms of single precision.
        np.testing.assert_allclose(half.mass_matrix()[k], expected, rtol=0, atol=1e-5 * np.abs(mass).max())
        np.testing.assert_allclose(bias[k], data.qfrc_bias, atol=1e-10 * size)
        np.testing.assert_allclose(forces[k], data.qfrc_inverse, atol=1e-9 * size)


def test_forces_of_inverse_dynamics_make_the_acceleration():
    """What it says is applied, and the step without contacts accelerates so, whatever drives do between controls and joints."""
    free = stepper.load("""<mujoco><option gravity="0 0 -3"/><worldbody><body><joint name="a" axis="0 1 0" stiffness="2" damping=".3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/><body pos="0 0 -.4"><joint name="b" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></body></worldbody>
      <actuator><position joint="a" kp="5"/><motor joint="b"/></actuator></mujoco>""")
    drives = stepper.ActuatorModel(default=stepper.Drive(delay=0.01, lag=0.02))
    for settings in ({}, {"actuators": drives}):
        sim = stepper.Stepper(free, 3, **settings)
        sim.reset(qpos=[[0.1, 0.2], [-1, 0.4], [2, -0.3]], qvel=[[0, 1], [2, -1], [0.5, 0.5]])
        sim.step(np.full((3, 2), 0.3), nstep=7)
        wanted = np.random.default_rng(0).normal(size=(3, 2))
        sim.qfrc_applied[:] = sim.inverse_dynamics(wanted) - np.asarray(sim.qfrc_actuator)
        np.testing.assert_allclose(sim.qacc_smooth, wanted, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_what_is_read_by_name_is_the_attributes(precision):
    _, sim, *_ = crowd("gymnasium/humanoid", precision=precision)
    sim.step(nstep=3)
    model, dtype = sim.model, {"f64": np.float64, "f32": np.float32}[precision]
    for name in KINDS:
        found = sim.read(name)
        np.testing.assert_array_equal(found, np.asarray(getattr(sim, name)), name)
        found[...] = 0  # It is the caller's.
        if name not in ("xfrc_applied", "qfrc_applied", "actuator_saturation", "eq_active"):
            assert found.dtype == dtype, name
    np.testing.assert_array_equal(sim.read("xpos", "torso"), sim.xpos[:, model.body("torso").id])
    np.testing.assert_array_equal(sim.read("cvel", ["torso", -1]), sim.cvel[:, [1, -1]])
    root, knee = model.joint("root"), model.joint("left_knee")
    columns = [*range(root.qposadr, root.qposadr + 7), knee.qposadr]
    np.testing.assert_array_equal(sim.read("qpos", ["root", "left_knee"]), sim.qpos[:, columns])
    np.testing.assert_array_equal(sim.read("qacc", "left_knee"), sim.qacc[:, [knee.dofadr]])
    np.testing.assert_array_equal(sim.read("actuator_force", "left_knee"), sim.actuator_force[:, [model.actuator("left_knee").id]])


def test_a_stepper_without_an_axis_has_none():
    sim = stepper.Stepper(stepper_model("gymnasium/ant"))
    assert sim.read("xpos", "torso").shape == (3,)
    assert sim.mass_matrix().shape == (14, 14)
    assert sim.inverse_dynamics(np.zeros(14)).shape == (14,)
    sim.xfrc_applied[1, 2] = 5.0
    np.testing.assert_allclose(sim.inverse_dynamics(sim.qacc_smooth)[:3], [0, 0, 5.0], atol=1e-12)


@pytest.mark.parametrize(("call", "error", "said"), [
    (lambda sim: sim.read("xpo"), ValueError, "there is no quantity 'xpo'; did you mean xpos"),
    (lambda sim: sim.read("xpos", "tors"), KeyError, "torso"),
    (lambda sim: sim.read("xpos", 99), IndexError, "99"),
    (lambda sim: sim.inverse_dynamics(np.zeros((4, 14))), ValueError, r"qacc has shape \(4, 14\), must be \(5, 14\)"),
    (stepper.Stepper.jacobian, ValueError, "body"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, error, said):
    with pytest.raises(error, match=said):
        call(stepper.Stepper(stepper_model("gymnasium/ant"), ENVS))
