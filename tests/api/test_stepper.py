"""`stepper.Stepper`: shapes, errors, masks, what an environment may not do to its neighbours."""

import pickle
import threading

import numpy as np
import pytest
import stepper
from checks import every, raises
from golden import scenes
from models import mujoco_model, random_state, simulate, stepper_model

ROBOT = "dm_control/humanoid"
N = 10
TWO_BALLS = """<mujoco><option timestep="1e-3"/><worldbody><geom name="floor" type="plane" size="0 0 1"/>
  <body name="lower" pos="0 0 .1"><freejoint/><geom name="g0" size=".1" mass="1"/></body>
  <body name="upper" pos="0 0 .3"><freejoint/><geom name="g1" size=".1" mass="2"/></body></worldbody></mujoco>"""


def falling(num_envs: int | None = N, **options) -> stepper.Stepper:
    """Humanoids in different poses on and above the floor, on their way."""
    sim = simulate(stepper_model(ROBOT), num_envs, **options)
    rng = np.random.default_rng(4)
    qpos, qvel = map(np.array, zip(*(random_state(mujoco_model(ROBOT), rng) for _ in range(N)), strict=True))
    qpos[:, 2] = np.linspace(0.8, 1.6, N)
    if num_envs is None:
        qpos, qvel = qpos[0], qvel[0]
    sim.set_state(qpos, qvel)
    sim.step(nstep=40)
    return sim


def controls(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (N, stepper_model(ROBOT).nu))


# Shapes


@pytest.mark.parametrize(("num_envs", "precision"), [(None, "f64"), (1, "f64"), (N, "f64"), (N, "f32")])
def test_shapes_and_types(num_envs, precision):
    model = stepper_model(ROBOT)
    sim = simulate(model, num_envs, precision=precision)
    lead = () if num_envs is None else (num_envs,)
    sim.step(np.zeros((*lead, model.nu)), nstep=np.int64(1))
    arrays = {"qpos": model.nq, "qvel": model.nv, "ctrl": model.nu, "act": model.na}
    arrays |= {"sensordata": model.nsensordata, "sensordata_ideal": model.nsensordata, "qfrc_applied": model.nv}
    for name, width in arrays.items():
        array = getattr(sim, name)
        kind = np.float32 if precision == "f32" and name != "qfrc_applied" else np.float64
        assert (array.shape, array.dtype) == ((*lead, width), kind), name
        assert array.flags.c_contiguous
    assert sim.xfrc_applied.shape == (*lead, model.nbody, 6)
    for name, kind in {"time": "f", "status": "u", "residual": "f", "iterations": "u"}.items():
        value = np.asarray(getattr(sim, name))
        assert value.shape == lead
        assert value.dtype.kind == kind or num_envs is None
    assert sim.num_envs == num_envs
    assert np.abs(np.asarray(sim.time) - model.timestep).max() < 1e-15
    assert sim.mass_matrix().shape == (*lead, model.nv, model.nv)
    assert sim.qfrc_bias.shape == sim.qacc_smooth.shape == (*lead, model.nv)


@pytest.mark.parametrize("precision", [np.float32, np.dtype("f4"), "float32", "f32"])
def test_a_precision_is_given_as_numpy_names_it(precision):
    assert stepper.Stepper(stepper.load(scenes.PILE), precision=precision).precision == "f32"
    with pytest.raises(ValueError, match=r"precision is <class 'numpy\.float16'>, must be"):
        stepper.Stepper(stepper.load(scenes.PILE), precision=np.float16)


@pytest.mark.parametrize(("call", "found", "must"), [
    (lambda sim: sim.step(np.zeros(3)), "(3,)", ["(10, 21)", "(21,)"]),
    (lambda sim: sim.step(np.zeros((21, 10))), "(21, 10)", ["(10, 21)", "(21,)"]),
    (lambda sim: sim.step(np.zeros((N, 1, 21))), "(10, 1, 21)", ["(10, 21)"]),
    (lambda sim: sim.set_state(qpos=np.zeros((N, 27))), "(10, 27)", ["(10, 28)", "(28,)"]),
    (lambda sim: sim.set_state(qvel=np.zeros(28)), "(28,)", ["(10, 27)", "(27,)"]),
    (lambda sim: sim.set_state(qvel=np.zeros(27), envs=np.ones(9, bool)), "(9,)", ["(10,)"]),
    (lambda sim: sim.reset(qpos=np.zeros((9, 28))), "(9, 28)", ["(10, 28)", "(28,)"]),
    (lambda sim: sim.reset(np.ones((N, 1), bool)), "(10, 1)", ["(10,)"]),
    (lambda sim: setattr(sim, "qfrc_applied", np.zeros((N, 28))), "(10, 28)", ["(10, 27)"]),
    (lambda sim: setattr(sim, "xfrc_applied", np.zeros((N, 6))), "(10, 6)", ["(10, 17, 6)"]),
])  # fmt: skip
def test_a_wrong_shape_is_answered_with_both_shapes(call, found, must):
    sim = falling()
    before = sim.get_state()
    with pytest.raises(ValueError, match="shape") as error:
        call(sim)
    for shape in [found, *must]:
        assert shape.replace(" ", "") in str(error.value).replace(" ", "")
    assert sim.get_state() == before


def test_a_single_environment_takes_no_leading_axis():
    raises(ValueError, r"\(1, 21\).*\(21,\)", falling(None).step, np.zeros((1, 21)))


def test_controls_are_shared_by_all_environments_when_they_have_no_leading_axis():
    one, all_ = falling(), falling()
    one.step(controls()[3])
    all_.step(np.tile(controls()[3], (N, 1)))
    assert np.array_equal(one.qpos, all_.qpos)
    assert np.array_equal(one.ctrl, all_.ctrl)


def frozen(array):
    array = array.copy()
    array.flags.writeable = False
    return array


@pytest.mark.parametrize("given", [
    frozen, np.asfortranarray, lambda a: np.repeat(a, 2, axis=1)[:, ::2], np.ndarray.tolist, lambda a: a.astype(">f8"),
], ids=["read-only", "Fortran order", "strided", "list", "big-endian"])  # fmt: skip
def test_inputs_of_any_layout(given):
    expected, sim = falling(), falling()
    qpos, qvel = expected.qpos, expected.qvel
    for s, f in [(expected, lambda a: a), (sim, given)]:
        s.set_state(f(qpos), f(qvel))
        s.qfrc_applied = f(np.ones((N, 27)))
        s.step(f(controls()))
    assert np.array_equal(sim.qpos, expected.qpos)
    assert np.array_equal(sim.ctrl, controls())


# Errors.


@every(poison=[np.nan, np.inf, -np.inf], integrator=["euler", "midpoint", "implicit", "rk4"])
@pytest.mark.parametrize("dynamics", ["none", "integrator", "filter", "filterexact"])
def test_an_infinite_control_is_refused_as_nan_is(dynamics, integrator, poison):
    """It is not taken for the end of the control's range, nor of the activation's or the force's."""
    text = f"""<mujoco><worldbody><body><joint name="rail" type="slide"/><geom size=".1"/></body></worldbody><actuator>
      <general joint="rail" dyntype="{dynamics}" dynprm=".1" ctrlrange="-1 1" {"" if dynamics == "none" else 'actrange="-1 1"'}
        forcerange="-1 1" gainprm="2"/></actuator></mujoco>"""
    sim = stepper.Stepper(stepper.load(text), 2, options=stepper.Options(integrator=integrator))
    sim.step([[poison], [0.5]])
    assert sim.status[0] & stepper.Status.NON_FINITE
    assert sim.status[1] == stepper.Status.OK
    assert sim.qvel[0] == 0
    assert sim.time[0] == 0
    sim.step([[0.5], [0.5]])
    assert sim.status[0] == stepper.Status.OK


@every(poison=[np.nan, np.inf, -np.inf], integrator=["euler", "midpoint", "implicit", "rk4"])
def test_a_non_finite_force_stays_in_its_environment(poison, integrator):
    """The environment keeps its last finite state and says so; the others go on as if nothing had happened, bit for bit."""
    sick, well = falling(integrator=integrator), falling(integrator=integrator)
    before, patient = (sick.qpos, sick.qvel, sick.time), 4
    others = np.arange(N) != patient
    sick.qfrc_applied[patient, 3] = poison
    sick.step(controls(), nstep=3)
    well.step(controls(), nstep=3)
    assert sick.status[patient] & stepper.Status.NON_FINITE
    assert not (sick.status[others] & stepper.Status.NON_FINITE).any()
    for a, b, old in zip((sick.qpos, sick.qvel, sick.time), (well.qpos, well.qvel, well.time), before, strict=True):
        assert np.array_equal(a[others], b[others])
        assert np.array_equal(a[patient], old[patient])
    sick.qfrc_applied[:] = 0
    sick.step(controls())
    assert not sick.status[patient] & stepper.Status.NON_FINITE
    assert np.isfinite(sick.qpos).all()


def test_a_step_that_is_not_taken_has_an_infinite_residual():
    """The numbers of a rejected step, which depend on the other environments of the group, are not reported."""
    model = stepper.load(scenes.WHIRL)
    rng = np.random.default_rng(0)
    sim = stepper.Stepper(model, 64, options=stepper.Options(integrator="euler"))
    sim.set_state(model.qpos0 + rng.uniform(-0.05, 0.05, (64, model.nq)), rng.uniform(-1, 1, (64, model.nv)) * 2e61)
    refused = 0
    for _ in range(20):
        sim.step()
        lost = (sim.status & stepper.Status.NON_FINITE) != 0
        refused += np.count_nonzero(lost)
        assert np.isposinf(sim.residual[lost]).all()
        assert not (sim.status[lost] & stepper.Status.NOT_CONVERGED).any()
    assert refused > 0


@pytest.mark.parametrize("method", ["set_state", "reset"])
def test_a_quaternion_of_zeros_is_named(method):
    sim = falling()
    qpos = sim.qpos.copy()
    qpos[6, 3:7] = 0
    raises(ValueError, r"environment 6.*root", lambda: getattr(sim, method)(qpos=qpos))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_state_that_is_not_finite_is_named(value):
    sim = falling()
    qvel = sim.qvel.copy()
    qvel[3, 11] = value
    raises(ValueError, r"qvel\[11\] of environment 3", sim.set_state, qvel=qvel)


def test_quaternions_are_normalised():
    sim = falling(None)
    qpos = sim.qpos
    sim.set_state(qpos=qpos * np.where((np.arange(28) > 2) & (np.arange(28) < 7), 3.0, 1.0))
    assert sim.qpos == pytest.approx(qpos, abs=1e-15)


# Episodes


def test_a_pickle_keeps_what_the_user_applied():
    sim = falling(timestep=3e-3, integrator="euler")
    sim.qfrc_applied[2, 7], sim.xfrc_applied[5, 3, 2] = 30.0, 200.0
    sim.step(controls())
    copy = pickle.loads(pickle.dumps(sim))
    assert (copy.options, copy.num_envs, copy.seed, copy.model) == (sim.options, sim.num_envs, sim.seed, sim.model)
    assert np.array_equal(copy.ctrl, sim.ctrl)
    assert np.array_equal(copy.xfrc_applied, sim.xfrc_applied)
    for s in (sim, copy):
        s.step(nstep=5)
    assert np.array_equal(copy.qpos, sim.qpos)


# Contacts


def test_contacts_say_who_touches_whom_where_and_how_hard():
    """Two balls stand on one another: the floor carries 3 kg, the lower ball 2 kg."""
    contacts = simulate(TWO_BALLS, 2, tolerance=1e-6, steps=2).contacts(1)
    assert contacts["geom"].tolist() == [[0, 1], [1, 2]]
    assert contacts["body"].tolist() == [[0, 1], [1, 2]]
    assert contacts["normal"] == pytest.approx(np.array([[0, 0, 1], [0, 0, 1]]), abs=1e-15)
    # Free fall within a step moves what is found by g h^2 / 2 = 5e-6 m.
    assert contacts["pos"] == pytest.approx(np.array([[0, 0, 0], [0, 0, 0.2]]), abs=2e-5)
    assert contacts["distance"] == pytest.approx(np.zeros(2), abs=2e-5)
    # A solver residual of 1e-6 m/s acting on 3 kg for a step of 1 ms.
    assert contacts["force"] == pytest.approx(9.81 * np.array([[3.0, 0, 0], [2.0, 0, 0]]), abs=1e-2)
    frames = contacts["frame"]
    assert frames @ frames.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (2, 1, 1)), abs=1e-15)
    assert np.array_equal(frames[:, 0], contacts["normal"])
    assert np.linalg.det(frames) == pytest.approx(np.ones(2))


def test_no_contacts_are_an_empty_array_with_the_same_fields():
    sim = simulate(TWO_BALLS)
    sim.set_state(qpos=sim.qpos + np.array([0, 0, 10, 0, 0, 0, 0, 0, 0, 20, 0, 0, 0, 0]))
    assert sim.contacts().shape == (0,)
    assert sim.contacts().dtype.names == ("env", "geom", "body", "pos", "normal", "distance", "force", "torque", "frame")


def test_full_contacts_are_flagged():
    """A box needs four of its corners and has room for three: it says so, in its environment only."""
    box = '<body><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    text = f'<mujoco><worldbody><geom type="plane" size="0 0 1"/>{box}</worldbody></mujoco>'
    sim = simulate(text, 2, max_contacts=3, qpos=np.array([[0, 0, 0.1, 1, 0, 0, 0], [0, 0, 5, 1, 0, 0, 0]]), steps=1)
    assert sim.status.tolist() == [stepper.Status.CONTACTS_FULL, stepper.Status.OK]
    assert len(sim.contacts(0)) == 3


def test_a_step_that_runs_out_of_sweeps_says_so():
    """And says by how much; the flags are all that happened during the call."""
    sim = falling(iterations=1, tolerance=1e-12, solver="pgs")
    assert (sim.status & stepper.Status.NOT_CONVERGED).any()
    bad = sim.residual > 1e-12
    sim.step()
    assert bad.any()
    assert np.array_equal(sim.residual > 1e-12, (sim.status & stepper.Status.NOT_CONVERGED) != 0)


# Threads


def test_the_gil_is_released_while_stepping():
    """A Python thread counts while one call of step runs: it could not once if the call held the lock."""
    sim = falling()
    counted, running, entered = [0], threading.Event(), threading.Event()

    def count():
        entered.wait()
        while not running.is_set():
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    entered.set()
    start = counted[0]
    sim.step(nstep=2000)
    during = counted[0] - start
    running.set()
    thread.join()
    assert during > 1000


def test_two_simulations_step_in_two_threads():
    expected = falling()
    expected.step(controls(), nstep=200)
    sims = [falling(), falling()]
    threads = [threading.Thread(target=sim.step, args=(controls(),), kwargs={"nstep": 200}) for sim in sims]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for sim in sims:
        assert np.array_equal(sim.qpos, expected.qpos)


@pytest.mark.parametrize(("field", "value"), [("mocap_pos", np.nan), ("mocap_pos", np.inf), ("mocap_quat", 0.0), ("mocap_quat", np.nan)])
def test_a_mocap_pose_that_is_none_stops_its_environment(field, value):
    """It would else hide the body's contacts, and what stands on it would fall."""
    scene = """<mujoco><worldbody><body mocap="true"><geom type="plane" size="1 1 1"/></body>
      <body pos="0 0 .1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    sim = stepper.Stepper(stepper.load(scene), 3)
    getattr(sim, field)[1] = value
    sim.step(nstep=100)
    assert sim.status.tolist() == [0, stepper.Status.NON_FINITE, 0]
    assert np.abs(sim.qpos[:, 2] - 0.1).max() < 1e-5  # The slop.


def test_a_model_error_pickles():
    assert pickle.loads(pickle.dumps(stepper.ModelError("why"))).args == ("why",)


def ant(**settings):
    return stepper.Stepper(stepper_model("gymnasium/ant"), **settings)


@pytest.mark.parametrize(("call", "error", "message"), [
    (lambda: ant(num_envs=0), ValueError, "num_envs"),
    (lambda: ant(num_envs=-1), ValueError, "num_envs is -1"),
    (lambda: ant(num_envs=2.5), TypeError, r"num_envs is 2\.5 \(float\)"),
    (lambda: ant(num_envs=10**12), MemoryError, "num_envs smaller"),
    (lambda: ant(num_envs=10**30), ValueError, "num_envs is 1000"),
    (lambda: ant(precision="f16"), ValueError, "precision.*f16.*f32"),
    (lambda: ant(threads=-1), ValueError, "threads is -1"),
    (lambda: ant(seed=-1), ValueError, "seed is -1"),
    (lambda: ant(seed="x"), TypeError, "seed is 'x'"),
    (lambda: ant(options=5), TypeError, r"options is 5 \(int\), must be a stepper\.Options"),
    (lambda: stepper.Options(iterations=-1), ValueError, "option iterations is -1"),
    (lambda: stepper.Options(iterations=10**12), ValueError, "option iterations"),
    (lambda: stepper.Options(max_contacts=-1), ValueError, "option max_contacts is -1"),
    (lambda: stepper.Options(slop="a"), TypeError, "option slop is 'a'"),
    (lambda: ant().step(nstep=-1), ValueError, "nstep is -1"),
    (lambda: ant().step(nstep=1.5), TypeError, r"nstep is 1\.5"),
    (lambda: ant().reset(seed=-4), ValueError, "seed is -4"),
    (lambda: stepper.load(""), IsADirectoryError, "path of a file or XML text"),
])  # fmt: skip
def test_settings_and_counts_that_are_none_are_named(call, error, message):
    raises(error, message, call)
