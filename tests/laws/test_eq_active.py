"""Equalities that are switched while a stepper runs: `Stepper.eq_active`, per environment, as in MuJoCo."""

import pickle

import mujoco
import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st

SCENE = """
<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
<body name="box" pos="0 0 .5"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>
<body name="arm" pos="1 0 1"><joint name="a" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".5"/>
<body name="hand" pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom type="sphere" size=".03" mass=".2"/></body></body>
<body name="ball" pos="2 0 .3"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody>
<equality><weld name="hold" body1="box"/><joint name="gear" joint1="a" joint2="b" polycoef="0 .5 0 0 0"/>
<connect name="pin" body1="ball" anchor="0 0 .2" active="{pin}"/></equality></mujoco>"""
NEQ = 3


def scene(pin: str = "false") -> stepper.Model:
    return stepper.load(SCENE.format(pin=pin))


def test_it_begins_as_the_models_and_is_bool():
    sim = stepper.Stepper(scene(), 2)
    assert sim.eq_active.dtype == bool
    assert sim.eq_active.tolist() == [[True, True, False]] * 2
    assert stepper.Stepper(scene()).eq_active.shape == (NEQ,)
    assert stepper.Stepper(stepper.load("<mujoco/>"), 2).eq_active.shape == (2, 0)


def test_a_weld_lets_go_and_holds_again():
    sim = stepper.Stepper(scene(), 2)
    sim.step(nstep=50)
    assert np.abs(sim.qpos[:, 2] - 0.5).max() < 1e-9
    sim.eq_active[1, 0] = False
    sim.step(nstep=50)
    # Free fall for 0.1 s, by the midpoint rule, which is exact for it.
    assert abs(sim.qpos[0, 2] - 0.5) < 1e-9
    assert np.isclose(sim.qpos[1, 2], 0.5 - 9.81 * 0.1**2 / 2, atol=1e-9)
    assert sim.max_equality_violation.max() < 1e-3
    assert sim.status.tolist() == [0, 0]
    sim.eq_active = True
    sim.step(nstep=2000)
    # Positions are corrected until the weld has its pose again, to the slop of a position solve.
    assert np.abs(sim.qpos[:, 2] - 0.5).max() < 1e-5
    assert sim.eq_active.all()


def test_mujocos_law_is_mujocos_when_it_is_switched():
    compiled = mujoco.MjModel.from_xml_string(SCENE.format(pin="false"))
    compiled.opt.iterations, compiled.opt.tolerance = 200, 1e-14
    data = mujoco.MjData(compiled)
    sim = stepper.Stepper(stepper.load(compiled), options=stepper.Options(contact="mujoco", integrator="euler", tolerance=1e-12))
    for active in ([1, 1, 0], [0, 1, 1], [1, 0, 1]):
        data.eq_active[:] = active
        sim.eq_active[:] = active
        for _ in range(20):
            mujoco.mj_step(compiled, data)
        sim.step(nstep=20)
        # As far as MuJoCo solves its own problem; docs/explanation/mujoco_law.md has 1e-9 a step at its tolerance.
        np.testing.assert_allclose(sim.qvel, data.qvel, atol=1e-6)


def test_recordings_pickles_and_rollouts_have_it(tmp_path):
    sim = stepper.Stepper(scene(), 2)
    with sim.record(tmp_path / "run"):
        sim.step(nstep=5)
        sim.eq_active[0] = [False, True, True]
        sim.step(nstep=20)
        sim.reset(np.array([True, False]))
        sim.eq_active[1, 1] = False
        sim.step(nstep=20)
    replayed = stepper.recording.verify(tmp_path / "run")
    assert replayed, str(replayed)
    again = pickle.loads(pickle.dumps(sim))
    assert np.array_equal(again.eq_active, sim.eq_active)
    rolled = again.rollout(np.zeros((10, 2, 0)))
    sim.step(nstep=10)
    assert np.array_equal(rolled["qpos"][-1] if isinstance(rolled, dict) else rolled.qpos[-1], sim.qpos)


def test_derivatives_have_it():
    sim = stepper.Stepper(scene())
    sim.eq_active[0] = False
    found = sim.linearize(("qvel",))
    # Free of its weld, the box keeps its velocity; held, it would lose it.
    held = stepper.Stepper(scene()).linearize(("qvel",))
    nv = sim.model.nv
    assert abs(held.blocks["qvel"][nv + 2, 2]) < 1e-6
    assert np.isclose(found.blocks["qvel"][nv + 2, 2], 1.0, atol=1e-6)


def test_what_is_no_array_of_truths_is_refused():
    sim = stepper.Stepper(scene(), 2)
    with pytest.raises(ValueError, match=r"eq_active has shape \(2, 3\).*broadcast"):
        sim.eq_active = np.ones((2, 4), bool)
    for numbers in (np.nan, 2, [0.5, 1, 0], None):
        with pytest.raises(ValueError, match="must be bool"):
            sim.eq_active = numbers
    sim.eq_active.dtype = np.int8
    with pytest.raises(ValueError, match="eq_active was changed in place to another type or shape"):
        sim.step()


ROWS = st.lists(st.booleans(), min_size=NEQ, max_size=NEQ)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(ROWS, ROWS, ROWS), min_size=1, max_size=4), st.sampled_from(["hard", "mujoco"]), st.sampled_from(["f64", "f32"]))
def test_switches_of_one_environment_are_felt_by_no_other(schedule, contact, precision):
    """A batch in which every environment is switched as it likes has the bits of each alone, of a model that begins with its equalities."""
    own = {"options": stepper.Options(contact=contact), "precision": precision}
    batch = stepper.Stepper(scene("true"), 3, **own)
    alone = [stepper.Stepper(batch.model.replace(eq_active0=np.array(row, float)), 1, **own) for row in schedule[0]]
    for k, rows in enumerate(schedule):
        batch.eq_active = rows
        batch.step(nstep=20)
        for env, (sim, row) in enumerate(zip(alone, rows, strict=True)):
            if k:
                sim.eq_active = row
            sim.step(nstep=20)
            assert np.array_equal(sim.qpos[0], batch.qpos[env])
            assert np.array_equal(sim.residual[0], batch.residual[env])


BRANCHES = """
<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><joint axis="0 1 0" pos=".1 0 .1"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/></body>
<body pos=".1 0 .2"><joint axis="0 1 0" {joint}/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 .1" mass="1"/></body></body></worldbody>
<equality><joint joint1="b"/></equality></mujoco>"""


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("joint", ['range="-.1 .1"', 'frictionloss=".1"'])
@pytest.mark.parametrize("stabilization", ["split", "baumgarte"])
def test_rows_of_another_branch_are_summed_in_the_same_order_whatever_neighbours_switch_on(precision, joint, stabilization):
    """The limit and the equality share two degrees of freedom. The third of each is at different places in the row."""
    model, options = stepper.load(BRANCHES.format(joint=joint)), stepper.Options(stabilization=stabilization)
    rng = np.random.default_rng(0)
    qpos, qvel = 0.2 * rng.normal(size=(30, 2, model.nv)), rng.normal(size=(30, 2, model.nv))
    for q, v in zip(qpos, qvel, strict=True):
        runs = [stepper.Stepper(model, 2, precision=precision, options=options) for _ in range(2)]
        for sim, others in zip(runs, (False, True), strict=True):
            sim.set_state(qpos=q, qvel=v)
            sim.eq_active = [[False], [others]]
            sim.step(nstep=20)
        assert np.array_equal(runs[0].qvel[0], runs[1].qvel[0])


@pytest.mark.parametrize("name", ["qacc", "qfrc_constraint", "sensordata_ideal"])
def test_quantities_of_a_reset_environment_need_no_solution_of_its_neighbours(name):
    """With MuJoCo's law, the reset environment has no active equality, and this evaluation does not solve the row of its neighbour."""
    scene = """<mujoco><worldbody><body name="b" pos="0 0 1"><freejoint/><geom size=".1"/><site name="s"/></body></worldbody>
    <equality><connect body1="b" anchor="0 0 .1" active="false"/></equality><sensor><accelerometer site="s"/></sensor></mujoco>"""
    sim = stepper.Stepper(stepper.load(scene), 2, options=stepper.Options(contact="mujoco"))
    alone = stepper.Stepper(stepper.load(scene), 2, options=stepper.Options(contact="mujoco"))
    for one, neighbour in ((sim, True), (alone, False)):
        one.step()
        one.eq_active[1, 0] = neighbour
        one.reset([0])
    assert np.array_equal(getattr(sim, name)[0], getattr(alone, name)[0])


def test_a_state_contains_the_active_equalities():
    """`set_state` restores them in the chosen environments, and the motion repeats bit for bit; reset restores the model's."""
    sim = stepper.Stepper(scene(), 3)
    plain = sim.get_state()
    sim.eq_active[1] = [False, True, True]
    sim.step(nstep=20)
    one, every = sim.get_state(env=1), sim.get_state()
    sim.step(nstep=20)
    after = sim.qpos.copy()
    sim.eq_active[:] = True
    sim.step(nstep=5)
    sim.set_state(every)
    assert sim.eq_active.tolist() == [[True, True, False], [False, True, True], [True, True, False]]
    sim.step(nstep=20)
    assert np.array_equal(sim.qpos, after)
    sim.set_state(one, envs=[2])
    assert sim.eq_active[2].tolist() == [False, True, True]
    sim.copy_state(0, envs=[1, 2])
    assert sim.eq_active.tolist() == [[True, True, False]] * 3
    sim.eq_active[0, 0] = False
    sim.copy_state(0, envs=[1])
    assert sim.eq_active[:, 0].tolist() == [False, False, True]
    for restore in (sim.reset, lambda mask: sim.set_state(plain, envs=mask)):
        sim.eq_active = False
        sim.step()
        restore(np.array([True, False, False]))
        assert sim.eq_active.tolist() == [[True, True, False], [False] * 3, [False] * 3]
    fresh = stepper.Stepper(scene())
    fresh.set_state(one)
    assert fresh.eq_active.tolist() == [False, True, True]
