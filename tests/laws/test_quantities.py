"""What the last step did, as it is read of all environments at once: it follows from states, contacts and the equation of motion."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, random_state, stepper_model
from rotations import matrix

ENVS = 18
READ = (
    "xpos", "xquat", "body_linvel", "body_angvel", "site_xpos", "site_xquat", "geom_xpos", "geom_xquat", "subtree_com", "qacc",
    "actuator_force", "qfrc_actuator", "qfrc_constraint", "body_contact_force", "xipos", "cinert", "cvel", "cfrc_ext",
)  # fmt: skip
ROBOTS = ["gymnasium/humanoid", "gymnasium/ant", "dm_control/quadruped", "dm_control/manipulator"]
MOCAP = """
<mujoco><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"><geom size=".1"/>
    <body name="finger" pos="0 0 .2"><joint name="finger" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
      <site name="tip" pos=".2 0 0"/></body>
  </body></worldbody></mujoco>"""


def crowd(name: str, steps: int = 40, **options) -> stepper.Stepper:
    """Robots that have fallen into contact."""
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    sim = stepper.Stepper(stepper_model(name), ENVS, options=stepper.Options(**options))
    rng = np.random.default_rng(7)
    _, v = zip(*(random_state(source, rng, 0.5) for _ in range(ENVS)), strict=True)
    sim.set_state(qvel=v)
    for _ in range(steps):
        sim.step(rng.uniform(-0.3, 0.3, (ENVS, source.nu)), nstep=5)
    return sim


@pytest.mark.parametrize("integrator", ["euler", "midpoint", "implicit", "rk4"])
def test_accelerations_are_differences_of_velocities(integrator):
    sim = crowd("gymnasium/humanoid", integrator=integrator)
    before = sim.qvel
    sim.step()
    np.testing.assert_allclose(sim.qacc, (sim.qvel - before) / sim.timestep, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_state_that_was_set_answers_with_the_step_that_follows(name):
    sim = crowd(name)
    q, v, act = sim.qpos, sim.qvel, sim.act
    sim.set_state(q, v, act=act)
    promised = {read: getattr(sim, read) for read in ("qacc", "qfrc_constraint", "body_contact_force")}
    assert np.array_equal(sim.qpos, q)
    assert np.array_equal(sim.qvel, v)
    sim.step()
    for read in ("qacc", "qfrc_constraint"):
        assert np.array_equal(getattr(sim, read), promised[read])
    # Its torque is about the centre of mass that has moved since.
    assert np.array_equal(sim.body_contact_force[..., :3], promised["body_contact_force"][..., :3])
    assert np.abs(sim.body_contact_force).max() > 1


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_on_bodies_are_sums_of_contacts(name):
    sim = crowd(name)
    expected = np.zeros((ENVS, sim.model.nbody, 6))
    ends = np.zeros((ENVS, sim.model.nbody, 3))
    for contact in sim.contacts():
        force, torque = contact["force"] @ contact["frame"], contact["torque"] @ contact["frame"]
        for body, sign in zip(contact["body"], (-1, 1), strict=True):
            centre = sim.xpos[contact["env"], body] + matrix(sim.xquat[contact["env"], body]) @ sim.model.body_ipos[body]
            ends[contact["env"], body] = centre
            expected[contact["env"], body] += sign * np.r_[force, torque + np.cross(contact["pos"] - centre, force)]
    scale = np.abs(expected).max()
    assert scale > 10
    np.testing.assert_allclose(sim.body_contact_force, expected, atol=1e-12 * scale)
    # Every action has its reaction.
    np.testing.assert_allclose(sim.body_contact_force[..., :3].sum(axis=1), 0, atol=1e-12 * scale)


@pytest.mark.parametrize("name", ["gymnasium/humanoid", "gymnasium/ant", "dm_control/manipulator"])
def test_constraint_forces_are_what_the_equation_of_motion_leaves(name):
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    source.dof_damping[:] = source.jnt_stiffness[:] = 0
    sim = stepper.Stepper(stepper.load(source, strict=False), ENVS, options=stepper.Options(integrator="euler"))
    rng = np.random.default_rng(8)
    sim.set_state(qvel=rng.normal(scale=0.3, size=(ENVS, source.nv)))
    sim.step(nstep=150)
    free, mass = sim.qacc_smooth, sim.mass_matrix()
    sim.step()
    expected = np.einsum("eij,ej->ei", mass, sim.qacc - free)
    scale = np.abs(expected).max()
    assert scale > 0.1
    np.testing.assert_allclose(sim.qfrc_constraint, expected, atol=1e-9 * scale)


def test_an_array_is_the_same_one_until_something_changes():
    sim = stepper.Stepper(stepper.load(MOCAP), 3)
    changes = {
        "step": lambda: sim.step(nstep=5),
        "set_state": lambda: sim.set_state(qpos=[[0.1], [0.2], [0.3]]),
        "reset": lambda: sim.reset([True, False, False]),
        "state": lambda: sim.set_state(state),
        "mocap": lambda: sim.mocap_pos.__setitem__((1, 0, 2), 5.0),
        "randomize": lambda: sim.randomize(geom_pos=np.full((3, 2, 3), 0.25)),
    }
    state = sim.get_state()
    sim.mocap_quat[:] = [1, 0, 0, 0]
    sim.set_state(qpos=[[1.0], [1.0], [1.0]])
    for name, change in changes.items():
        before = sim.geom_xpos
        assert sim.geom_xpos is before, name
        _ = sim.qpos, sim.xquat, sim.contacts(), sim.sensordata, sim.qacc
        assert sim.geom_xpos is before, name
        kept = before.copy()
        change()
        assert not np.array_equal(sim.geom_xpos, kept), name
        assert np.array_equal(before, kept), f"{name}: what was handed out stays"


def test_what_hangs_from_a_posed_body_goes_with_it():
    sim = stepper.Stepper(stepper.load(MOCAP), 2)
    sim.mocap_pos[1, 0] = [3, 0, 0]
    sim.mocap_quat[1, 0] = [2, 0, 0, 2]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(sim.xquat[1], [[1, 0, 0, 0], [half, 0, 0, half], [half, 0, 0, half]], atol=1e-15)
    np.testing.assert_allclose(sim.site_xpos[:, 0], [[0.2, 0, 1.2], [3, 0.2, 0.2]], atol=1e-15)
    np.testing.assert_allclose(sim.jacobian(site="tip")[1, :, 0], [0, 0, -0.2, -1, 0, 0], atol=1e-15)
    assert np.array_equal(sim.jacobian(body="hand"), np.zeros((2, 6, 1)))


@pytest.mark.parametrize("read", READ)
def test_what_is_read_cannot_be_written(read):
    sim = stepper.Stepper(stepper_model("gymnasium/ant"), 2)
    with pytest.raises(ValueError, match="read-only"):
        getattr(sim, read)[...] = 0
    with pytest.raises(AttributeError, match=read):
        setattr(sim, read, 0)
    precise, rough, single = sim, stepper.Stepper(sim.model, 2, precision="f32"), stepper.Stepper(sim.model)
    assert (getattr(precise, read).dtype, getattr(rough, read).dtype) == (precise.qpos.dtype, rough.qpos.dtype)
    assert getattr(single, read).shape == getattr(sim, read).shape[1:]


def test_jacobians_need_one_thing_that_exists():
    sim = stepper.Stepper(stepper_model("gymnasium/ant"), 2)
    for given, error, text in [
        ({}, ValueError, "give body= or site="),
        ({"body": 1, "site": 0}, ValueError, "one of them"),
        ({"body": "torsoo"}, KeyError, "no body 'torsoo'; did you mean torso"),
        ({"body": 99}, IndexError, "body is 99, must be below"),
        ({"site": 1.5}, TypeError, "site, if it is no name, is 1.5"),
    ]:
        with pytest.raises(error, match=text):
            sim.jacobian(**given)
    mine = sim.jacobian(body="torso")
    mine[:] = 0
    assert np.abs(sim.jacobian(body="torso")).max() == 1


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_forces_of_actuators_are_what_sensors_read(precision):
    """Drives with delay, lag, friction and losses among them: one computation, two ways to read it."""
    source = """
    <mujoco><worldbody><body><joint name="a" axis="0 1 0" damping=".1"/><geom size=".1" pos=".3 0 0"/>
      <body pos=".5 0 0"><joint name="b" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body></body></worldbody>
      <actuator><motor name="a" joint="a" gear="3"/><position name="b" joint="b" kp="20" forcerange="-2 2"/></actuator>
      <sensor><actuatorfrc actuator="a"/><actuatorfrc actuator="b"/>
        <jointactuatorfrc joint="a"/><jointactuatorfrc joint="b"/></sensor></mujoco>"""
    motor = stepper.actuators.DCMotor(stall_torque=2.0, no_load_speed=40.0, gear=3.0, efficiency=0.8)
    drives = stepper.ActuatorModel({"a": stepper.Drive(delay=0.005, motor=motor), "b": stepper.Drive(lag=0.02, friction=0.1)})
    for actuators in (None, drives):
        sim = stepper.Stepper(stepper.load(source), ENVS, actuators=actuators, precision=precision)
        sim.set_state(qpos=np.random.default_rng(1).normal(size=(ENVS, 2)))
        for ctrl in np.random.default_rng(2).normal(size=(6, ENVS, 2)):
            sim.step(ctrl, nstep=3)
            assert np.array_equal(np.concatenate([sim.actuator_force, sim.qfrc_actuator], axis=1), sim.sensordata_ideal)
        assert np.abs(sim.actuator_force).max() > 0.1
