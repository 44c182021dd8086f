"""`max_equality_violation` and its flag: the position error of loops and couplings after a step, beside MuJoCo's kinematics."""

import mujoco
import numpy as np
import pytest
import stepper
from equalities import KINDS, LINKAGE, rows_of
from hypothesis import given
from hypothesis import strategies as st
from laws.test_closed_loops import LOOPS, four_bar, turning
from models import forward, random_state, simulate, stepper_model

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
    sim = simulate(model, 9, precision=precision, stabilization="none", timestep=1e-6)
    sim.set_state(qpos=qpos)
    sim.step()
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
    sim = simulate(LOOPS["crank and rocker"], 2)
    sim.set_state(qpos=[[0.1, -0.1, 0.2], [0.0, 0.0, 0.0]])
    sim.step()
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
        sim = stepper.Stepper(soft, options=stepper.Options(contact=law))
        sim.step(nstep=2000)
        assert (sim.max_equality_violation > 1e-4) == told
        assert abs(float(sim.qpos[0])) > 1e-4
        assert bool(sim.status & VIOLATED) == (float(sim.max_equality_violation) > 1e-3)
    for sim in (stepper.Stepper(stepper.load(SPRING.format(""))), stepper.Stepper(stepper_model("gymnasium/ant"))):
        sim.step(nstep=10)
        assert sim.max_equality_violation == 0
        assert not sim.status & VIOLATED
