"""Quantities of the last step, read of all environments at once: they follow from states, contacts and the equations of motion."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from equalities import KINDS, LINKAGE, rows_of
from geometry import matrix
from hypothesis import given, strategies as st
from laws.test_closed_loops import LOOPS, four_bar, turning
from models import SOURCES, forward, random_state, simulate, stepper_model

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
    sim.set_state(qvel=np.random.default_rng(8).normal(scale=0.3, size=(ENVS, source.nv)))
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
    raises(AttributeError, read, setattr, sim, read, 0)
    precise, rough, single = sim, stepper.Stepper(sim.model, 2, precision="f32"), stepper.Stepper(sim.model)
    assert (getattr(precise, read).dtype, getattr(rough, read).dtype) == (precise.qpos.dtype, rough.qpos.dtype)
    assert getattr(single, read).shape == getattr(sim, read).shape[1:]


def test_jacobians_need_one_thing_that_exists():
    sim = stepper.Stepper(stepper_model("gymnasium/ant"), 2)
    for body_or_site, error, text in [
        ({}, ValueError, "give body= or site="),
        ({"body": 1, "site": 0}, ValueError, "one of them"),
        ({"body": "torsoo"}, KeyError, "no body 'torsoo'; did you mean torso"),
        ({"body": 99}, IndexError, "body is 99, must be below"),
        ({"site": 1.5}, TypeError, "site, if it is no name, is 1.5"),
    ]:
        raises(error, text, sim.jacobian, **body_or_site)
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
        sim = simulate(source, ENVS, actuators=actuators, precision=precision, qpos=np.random.default_rng(1).normal(size=(ENVS, 2)))
        for ctrl in np.random.default_rng(2).normal(size=(6, ENVS, 2)):
            sim.step(ctrl, nstep=3)
            assert np.array_equal(np.concatenate([sim.actuator_force, sim.qfrc_actuator], axis=1), sim.sensordata_ideal)
        assert np.abs(sim.actuator_force).max() > 0.1


# `max_equality_violation` and its flag: the position error of loops and couplings after a step, beside MuJoCo's kinematics.

VIOLATED = stepper.Status.EQUALITY_VIOLATED
SPRING = (
    '<mujoco><worldbody><body name="a"><joint name="j" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>{}</mujoco>'
)


def violation(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Largest error of the equalities at a configuration, in m or rad, from MuJoCo's kinematics."""
    rows, largest = rows_of(model, data), 0.0
    for i in np.unique(rows.owner):
        error = rows.error[rows.owner == i]
        largest = max(largest, float(np.linalg.norm(error[:3])))
        if len(error) == 6 and model.eq_data[i, 10] > 0:
            largest = max(largest, float(np.linalg.norm(error[3:])) / model.eq_data[i, 10])
    return largest


def placed(model: mujoco.MjModel, sim: stepper.Stepper) -> mujoco.MjData:
    """MuJoCo's data where a stepper of one environment is."""
    data = mujoco.MjData(model)
    data.qpos[:] = sim.qpos
    if model.nmocap:
        data.mocap_pos[:], data.mocap_quat[:] = sim.mocap_pos, sim.mocap_quat
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("precision", "rounding"), [
    # Twenty operations on lengths of 1 m and angles of pi.
    ("f64", 1e-13),
    ("f32", 1e-5),
])  # fmt: skip
def test_it_is_the_error_of_mujocos_kinematics(kind, precision, rounding):
    """Of every kind of equality at random configurations, in every environment."""
    model, rng = mujoco.MjModel.from_xml_string(LINKAGE.format(equality=KINDS[kind])), np.random.default_rng(3)
    qpos = np.array([random_state(model, rng)[0] for _ in range(9)])
    sim = simulate(model, 9, precision=precision, stabilization="none", timestep=1e-6, qpos=qpos, steps=1)
    found = [violation(model, forward(model, q, np.zeros(model.nv))) for q in np.asarray(sim.qpos)]
    np.testing.assert_allclose(sim.max_equality_violation, found, rtol=0, atol=rounding)
    assert np.array_equal((sim.status & VIOLATED) != 0, sim.max_equality_violation > 1e-3)


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(KINDS)), st.sampled_from(["hard", "mujoco"]), st.sampled_from(["f64", "f32"]))
def test_it_is_the_largest_error_after_the_steps_of_a_call(seed, kind, contact, precision):
    """Also far from the origin of the world, of a moving mocap body, and with MuJoCo's law, by which equalities are soft."""
    model, rng = mujoco.MjModel.from_xml_string(LINKAGE.format(equality=KINDS[kind])), np.random.default_rng(seed)
    loaded, options = stepper.load(model), stepper.Options(contact=contact, timestep=2e-3)
    one, many = (stepper.Stepper(loaded, options=options, precision=precision) for _ in range(2))
    qpos, qvel = model.qpos0 + rng.uniform(-0.05, 0.05, model.nq), rng.uniform(-2, 2, model.nv)
    pose = rng.uniform(-0.1, 0.1, (model.nmocap, 3)) + np.array([0.3, 0.1, 0.8])
    for sim in (one, many):
        sim.set_state(qpos=qpos, qvel=qvel)
        sim.mocap_pos[:] = pose
    many.step(nstep=5)
    largest = 0.0
    for _ in range(5):
        one.step()
        # Rounding of twenty operations on lengths of 1 m and angles of pi.
        expected = pytest.approx(violation(model, placed(model, one)), abs=1e-12 if precision == "f64" else 1e-5)
        assert float(one.max_equality_violation) == expected
        largest = max(largest, float(one.max_equality_violation))
    assert float(many.max_equality_violation) == largest


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_four_bar_that_turns_by_a_sixth_of_a_radian_a_step_says_that_it_opens(precision):
    """Every loop here keeps below the flag where it turns by 0.012 rad a step, and its certificate tells when it does not."""
    model, h = mujoco.MjModel.from_xml_string(four_bar(0.2, 0.5, 0.4, 0.45)), 1e-2
    sim = simulate(model, precision=precision, timestep=h)
    turning(model, sim, 17.0)
    worst = 0.0
    for _ in range(100):
        sim.step()
        own = violation(model, placed(model, sim))
        # Rounding of a chain of three links of half a metre.
        assert sim.max_equality_violation == pytest.approx(own, abs=1e-12 if precision == "f64" else 1e-6)
        assert bool(sim.status & VIOLATED) == (float(sim.max_equality_violation) > 1e-3)
        worst = max(worst, own)
    assert worst > 2e-3
    for name, xml in LOOPS.items():
        model = mujoco.MjModel.from_xml_string(xml)
        sim = simulate(model, precision=precision, timestep=2e-3)
        turning(model, sim, 6.0)
        sim.step(nstep=1000)
        assert sim.max_equality_violation < 3e-4, name  # 2.1e-4 at the kite's singularity, 2e-5 elsewhere.
        assert not sim.status & VIOLATED, name


def test_a_loop_that_is_torn_says_so_until_it_is_closed_again():
    """In its own environment alone. The correction takes a part of the error in every step."""
    sim = simulate(LOOPS["crank and rocker"], 2, qpos=[[0.1, -0.1, 0.2], [0.0, 0.0, 0.0]], steps=1)
    first = np.array(sim.max_equality_violation)
    assert first[0] > 0.05
    assert sim.status[0] & VIOLATED
    assert not sim.status[1] & VIOLATED
    sim.step(nstep=2000)
    assert sim.max_equality_violation[0] < first[0]
    assert (sim.status & VIOLATED != 0).tolist() == [True, False]
    sim.step(nstep=2000)
    assert (sim.max_equality_violation < 1e-3).all()
    assert not (sim.status & VIOLATED).any()


def test_reading_it_follows_the_last_call_as_its_siblings_do():
    """`set_state` and `reset` clear it with the rest of the outcome, and a saved state has it."""
    sim = simulate(LOOPS["kite"], 2, stabilization="none")
    sim.set_state(qpos=sim.qpos + 0.1)
    assert (sim.max_equality_violation == 0).all()
    sim.step(nstep=3)
    told, kept = np.array(sim.max_equality_violation), sim.get_state()
    assert (told > 1e-2).all()
    sim.set_state(qpos=np.zeros((2, 3)))
    assert sim.max_equality_violation.tolist() == sim.max_limit_violation.tolist() == [0.0, 0.0]
    sim.step()
    assert (sim.max_equality_violation < 1e-4).all()  # One step of free fall of a closed loop opens it by 2e-6.
    sim.set_state(kept)
    assert np.array_equal(sim.max_equality_violation, told)
    sim.reset(envs=[True, False])
    assert sim.max_equality_violation.tolist() == [0.0, told[1]]
    sim = simulate(LOOPS["kite"], 2, stabilization="none")
    rolled = simulate(LOOPS["kite"], 2, stabilization="none")
    for one in (sim, rolled):
        one.set_state(qpos=one.qpos + 0.1)
    sim.step(nstep=6)
    rolled.rollout(np.zeros((2, 0)), nstep=3)
    assert np.array_equal(sim.max_equality_violation, rolled.max_equality_violation)


def test_springs_do_not_count_with_hard_contact_and_nothing_is_told_without_equalities():
    """A mass of 1 kg stretches an equality of 100 N/m by a decimetre, as it should; MuJoCo's law counts its own softness."""
    model = stepper.load(SPRING.format('<equality><joint joint1="j"/></equality>'))
    soft = model.replace(eq_stiffness=[100.0], eq_damping=[20.0])
    for law, told in (("hard", False), ("mujoco", True)):
        sim = simulate(soft, contact=law, steps=2000)
        assert (sim.max_equality_violation > 1e-4) == told
        assert abs(float(sim.qpos[0])) > 1e-4
        assert bool(sim.status & VIOLATED) == (float(sim.max_equality_violation) > 1e-3)
    for sim in (stepper.Stepper(stepper.load(SPRING.format(""))), stepper.Stepper(stepper_model("gymnasium/ant"))):
        sim.step(nstep=10)
        assert sim.max_equality_violation == 0
        assert not sim.status & VIOLATED
