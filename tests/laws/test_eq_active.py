"""Equalities that change while a stepper runs, per environment: `Stepper.eq_active` as in MuJoCo, and `randomize(eq_data=...)`."""

import pickle

import mujoco
import numpy as np
import pytest
import stepper
from checks import every, raises
from geometry import matrix
from hypothesis import given, settings, strategies as st
from models import mjcf, simulate

SCENE = """
<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
<body name="box" pos="0 0 .5"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>
<body name="arm" pos="1 0 1"><joint name="a" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".5"/>
<body name="hand" pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom type="sphere" size=".03" mass=".2"/></body></body>
<body name="ball" pos="2 0 .3"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody>
<equality><weld name="hold" body1="box"/><joint name="gear" joint1="a" joint2="b" polycoef="0 .5 0 0 0"/>
<connect name="pin" body1="ball" anchor="0 0 .2" active="{pin}"/></equality></mujoco>"""
NEQ = 3
ROWS = st.lists(st.booleans(), min_size=NEQ, max_size=NEQ)
BRANCHES = """
<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><joint axis="0 1 0" pos=".1 0 .1"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/></body>
<body pos=".1 0 .2"><joint axis="0 1 0" {joint}/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 .1" mass="1"/></body></body></worldbody>
<equality><joint joint1="b"/></equality></mujoco>"""
FIXED = """
<mujoco><worldbody><body name="post" pos="0 0 1"><geom size=".1"/></body><body name="other" pos="1 0 1"><geom size=".1"/></body>
<body name="a" pos="0 0 2"><joint axis="0 1 0"/><geom size=".1"/><body name="child" pos=".3 0 0"><geom size=".1"/></body></body></worldbody>
<equality><weld name="posts" body1="post" body2="other" active="false"/><weld name="family" body1="a" body2="child" active="false"/>
<weld name="stand" body1="post" body2="child" active="false"/></equality></mujoco>"""


def scene(pin: str = "false") -> stepper.Model:
    return stepper.load(SCENE.format(pin=pin))


def test_it_begins_as_the_models_and_is_bool():
    sim = stepper.Stepper(scene(), 2)
    assert sim.eq_active.dtype == bool
    assert sim.eq_active.tolist() == [[True, True, False]] * 2
    assert stepper.Stepper(scene()).eq_active.shape == (NEQ,)
    assert stepper.Stepper(stepper.load("<mujoco/>"), 2).eq_active.shape == (2, 0)


def test_a_weld_lets_go_and_holds_again():
    sim = simulate(scene(), 2, steps=50)
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
        raises(ValueError, "must be bool", setattr, sim, "eq_active", numbers)
    sim.eq_active.dtype = np.int8
    raises(ValueError, "eq_active was changed in place to another type or shape", sim.step)


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


@every(precision=["f64", "f32"], joint=['range="-.1 .1"', 'frictionloss=".1"'], stabilization=["split", "baumgarte"])
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
    assert simulate(scene(), qpos=one).eq_active.tolist() == [False, True, True]


# Equalities whose numbers differ between environments: `randomize(eq_data=...)`, so that a weld holds the pose of a grasp.

GRASP_SCENE = mjcf("grasp")
GRASP, PIN, GEAR, LOCK = range(4)
LAWS = {"hard": stepper.Options(), "mujoco": stepper.Options(contact="mujoco", integrator="euler", tolerance=1e-12)}


def moving(num_envs: int | None = 3, contact: str = "hard", **more) -> stepper.Stepper:
    """Stepper whose environments have different poses and velocities."""
    model = stepper.load(GRASP_SCENE)
    sim = stepper.Stepper(model, num_envs, options=LAWS[contact], **more)
    qvel = np.random.default_rng(0).normal(0, 0.5, (num_envs or 1, model.nv))
    sim.set_state(qvel=qvel if num_envs else qvel[0])
    sim.step(nstep=50)
    return sim


def relative_pose(sim: stepper.Stepper, first: str, second: str) -> np.ndarray:
    """Position and orientation of the second body in the frame of the first, (num_envs, 12)."""
    a, b = (sim.model.body(name).id for name in (first, second))
    first_turn, second_turn = (np.array([matrix(quat) for quat in sim.xquat[:, body]]) for body in (a, b))
    apart = np.einsum("eji,ej->ei", first_turn, sim.xpos[:, b] - sim.xpos[:, a])
    return np.c_[apart, np.einsum("eji,ejk->eik", first_turn, second_turn).reshape(-1, 9)]


def test_elements_have_mujocos_numbers():
    source, model = mujoco.MjModel.from_xml_string(GRASP_SCENE), stepper.load(GRASP_SCENE)
    assert model.equality_names == ["grasp", "pin", "gear", "lock"]
    for k, kind in enumerate(("weld", "connect", "joint", "tendon")):
        ours, theirs = model.equality(k), source.equality(k)
        assert (ours.id, ours.name, ours.type, ours.active0) == (k, theirs.name, kind, bool(theirs.active0[0]))
        assert (ours.obj1id, ours.obj2id) == (theirs.obj1id[0], theirs.obj2id[0])
        used = {"weld": 11, "connect": 6}.get(kind, 5)
        np.testing.assert_allclose(ours.data[:used], theirs.data[:used], atol=1e-15)
    raises(KeyError, "no equality 'grip'; did you mean grasp", model.equality, "grip")


@pytest.mark.parametrize("contact", LAWS)
def test_a_weld_holds_the_pose_of_the_grasp(contact):
    """Two environments grasp, at different poses; the third is, bit for bit, one that never did."""
    sim, alone = moving(contact=contact), moving(contact=contact)
    grasped = [0, 2]
    before = relative_pose(sim, "tool", "box")
    sim.randomize({"eq_data[grasp]": sim.closed_eq_data[grasped, GRASP]}, envs=grasped)
    sim.eq_active[grasped, GRASP] = True
    for one in (sim, alone):
        one.step(nstep=100)  # The first of these stops the box on the tool, as an impact, and its error is larger.
        one.step(nstep=400)
    after = relative_pose(sim, "tool", "box")
    assert np.array_equal(sim.qpos[1], alone.qpos[1])
    if contact == "hard":
        # A step at 20 rad/s turns 0.04 rad; what its linearised rows miss is of third order, 1e-5, and the next step removes it.
        assert np.abs(after - before)[grasped].max() < 1e-5
        assert sim.max_equality_violation.max() < 1e-5
        assert sim.status.tolist() == [0, 0, 0]
    assert np.abs(after - before)[1].max() > 0.1
    sim.reset()
    assert not sim.eq_active.any()
    assert sim.randomized["eq_data"].shape == (3, 4, 11)


def test_without_the_new_numbers_the_weld_pulls_the_box_to_the_models_pose():
    sim = moving()
    before = relative_pose(sim, "tool", "box")
    sim.eq_active[:, GRASP] = True
    sim.step(nstep=2000)
    assert np.abs(relative_pose(sim, "tool", "box") - before).max() > 0.1


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_closed_numbers_leave_no_error_in_mujoco(precision):
    """All equalities close: MuJoCo, with the numbers as `eq_data`, has no position error at the same `qpos`."""
    sim = moving(precision=precision)
    data = sim.closed_eq_data
    source = mujoco.MjModel.from_xml_string(GRASP_SCENE)
    state = mujoco.MjData(source)
    for env in range(sim.num_envs):
        source.eq_data[:, :11] = data[env]
        state.qpos[:], state.eq_active[:] = sim.qpos[env], 1
        mujoco.mj_forward(source, state)
        errors = state.efc_pos[: state.ne]
        assert len(errors) == 6 + 3 + 1 + 1
        # Rounding of poses a metre from the origin.
        assert np.abs(errors).max() < (1e-12 if precision == "f64" else 1e-5)
    assert np.array_equal(sim.read("closed_eq_data", "grasp"), data[:, GRASP])
    assert np.array_equal(data[:, GRASP, 10], np.full(3, 0.4, data.dtype))
    np.testing.assert_allclose(data[:, GRASP, :3], [[0.01, 0.02, 0.03]] * 3, atol=1e-6)


@every(precision=["f64", "f32"], contact=LAWS)
def test_an_environment_is_one_of_a_model_with_its_numbers(contact, precision):
    """Every kind of equality, with numbers of each environment, moves bit for bit as in a model with these numbers."""
    model = stepper.load(GRASP_SCENE)
    rng = np.random.default_rng(1)
    data = np.tile(model.eq_data, (4, 1, 1))
    data[:, GRASP, :10] += rng.normal(0, 0.05, (4, 10))
    data[:, GRASP, 6:10] /= np.linalg.norm(data[:, GRASP, 6:10], axis=1, keepdims=True)
    data[:, GRASP, 10] = rng.uniform(0, 1, 4) * np.array([1, 1, 0, 1])
    data[:, PIN, :6] += rng.normal(0, 0.05, (4, 6))
    data[:, GEAR, :5] += rng.normal(0, 0.05, (4, 5))
    data[:, LOCK, 0] += rng.normal(0, 0.05, 4)
    sim = stepper.Stepper(model, 4, options=LAWS[contact], precision=precision)
    sim.randomize(eq_data=data)
    sim.eq_active[:] = [True, True, True, False]
    sim.eq_active[1] = [False, False, False, True]
    sim.step(nstep=60)
    for env in range(4):
        alone = stepper.Stepper(model.replace(eq_data=data[env]), options=LAWS[contact], precision=precision)
        alone.eq_active[:] = sim.eq_active[env]
        alone.step(nstep=60)
        assert np.array_equal(alone.qpos, sim.qpos[env])
        assert np.array_equal(alone.max_equality_violation, sim.max_equality_violation[env])
        assert np.array_equal(alone.closed_eq_data, sim.closed_eq_data[env])


def test_mujocos_law_is_mujocos_with_the_numbers_of_the_grasp():
    sim = moving(1, "mujoco")
    source = mujoco.MjModel.from_xml_string(GRASP_SCENE)
    source.opt.iterations, source.opt.tolerance = 200, 1e-14
    state = mujoco.MjData(source)
    state.qpos[:], state.qvel[:] = sim.qpos[0], sim.qvel[0]
    source.eq_data[:, :11] = sim.closed_eq_data[0]
    sim.randomize(eq_data=sim.closed_eq_data)
    state.eq_active[:] = sim.eq_active[0] = [True, True, True, False]
    for _ in range(100):
        mujoco.mj_step(source, state)
    sim.step(nstep=100)
    # As far as MuJoCo solves the problem; docs/explanation/mujoco_law.md has 1e-9 a step at its tolerance.
    np.testing.assert_allclose(sim.qvel[0], state.qvel, atol=1e-6)


def without(*names: str) -> stepper.Model:
    """Scene without some of its equalities."""
    spec = mujoco.MjSpec.from_string(GRASP_SCENE)
    for equality in list(spec.equalities):
        if equality.name in names:
            spec.delete(equality)
    return stepper.load(spec)


@every(contact=LAWS, active=["grasp", "gear", "lock", "grasp gear", "grasp pin"])
def test_switched_rows_are_those_of_a_model_without_the_others(active, contact):
    """Blocks of equalities are joined and eliminated as if all were active. What acts is as if the inactive ones were not there."""
    chosen = active.split()
    sim = stepper.Stepper(stepper.load(GRASP_SCENE), options=LAWS[contact])
    other = stepper.Stepper(without(*[name for name in sim.model.equality_names if name not in chosen]), options=LAWS[contact])
    for one in (sim, other):
        data, closed = np.array(one.model.eq_data), one.closed_eq_data
        one.randomize(eq_data=np.where(np.isin(one.model.equality_names, ["grasp", "lock"])[:, None], closed, data))
        one.eq_active[:] = np.isin(one.model.equality_names, chosen)
        one.step(nstep=50)
    # Blocks have other sizes, so that rounding and the last iterations differ; the tolerance of a solve is 1e-6 m/s.
    np.testing.assert_allclose(sim.qpos, other.qpos, atol=1e-6)
    assert sim.status == other.status


@pytest.mark.parametrize("contact", LAWS)
def test_a_weld_of_bodies_that_are_fixed_to_each_other_has_no_effect(contact):
    """The rows of bodies that the compiled model merges act on no degree of freedom; the weld can be switched, and its error is read."""
    model = stepper.load(FIXED)
    sim, free = (stepper.Stepper(model, 2, options=LAWS[contact]) for _ in range(2))
    sim.eq_active[1, :2] = True
    for one in (sim, free):
        one.step(nstep=50)
    np.testing.assert_allclose(sim.qpos, free.qpos, atol=1e-12)
    assert sim.status.tolist() == [0, 0]
    assert sim.max_equality_violation.max() < 1e-12
    data = np.tile(model.eq_data, (2, 1, 1))
    data[:, 0, 0] += 0.1
    sim.randomize(eq_data=data)
    sim.step()
    np.testing.assert_allclose(sim.max_equality_violation, [0, 0.1], atol=1e-9)


def test_welds_that_contradict_each_other_are_reported():
    """Two welds of the same bodies with the same pose act as one. With poses 0.1 m apart they cannot both close."""
    scene = GRASP_SCENE.replace("<connect", '<weld name="second" body1="tool" body2="box" active="false"/><connect')
    sim = stepper.Stepper(stepper.load(scene), 2)
    both = [sim.model.equality(name).id for name in ("grasp", "second")]
    data = np.array(sim.closed_eq_data)
    data[1, both[1], 3] += 0.1
    sim.randomize(eq_data=data)
    sim.eq_active[:, both] = True
    sim.step(nstep=200)
    assert sim.max_equality_violation[0] < 1e-5  # As with one weld, see above.
    assert sim.status[0] == 0
    assert sim.max_equality_violation[1] > 0.03
    assert sim.status[1] & stepper.Status.INFEASIBLE or sim.residual[1] > 1e-3


@pytest.mark.parametrize(("change", "text"), [
    (lambda data: data.__setitem__((1, GRASP, 0), np.nan), 'environment 1.*equality "grasp".*data.*NaN'),
    (lambda data: data.__setitem__((1, GRASP, slice(6, 10)), 0), 'environment 1.*equality "grasp".*relpose.*length 0.*length 1'),
    (lambda data: data.__setitem__((1, GRASP, 10), -1), 'environment 1.*equality "grasp".*torquescale'),
    (lambda data: data.__setitem__((1, PIN, 8), 1), 'environment 1.*field "eq_data".*give 0 where the kind of equality has no number'),
])  # fmt: skip
def test_numbers_that_no_equality_can_have_are_refused(change, text):
    sim = stepper.Stepper(stepper.load(GRASP_SCENE), 2)
    data = np.tile(sim.model.eq_data, (2, 1, 1))
    change(data)
    raises(stepper.ModelError, text, sim.randomize, eq_data=data)
    assert sim.randomized == {}
