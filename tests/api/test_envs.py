"""Environments that `envs` selects: what is copied, given away, reset and stepped of some, and what stays as it is."""

import inspect
import pickle

import numpy as np
import pytest
import stepper
from checks import every, raises
from hypothesis import given, strategies as hypothesis
from models import STATE, simulate, stepper_model
from stepper.envs import StepperVectorEnv
from stepper.viewer.frames import shown_envs

HOPPER = "dm_control/hopper"
DELAYED = stepper.SensorModel(default=stepper.Transfer(delay=0.013))
DRIVES = stepper.ActuatorModel(default=stepper.Drive(delay=0.017, lag=0.02))
HAND_MOVED = """
<mujoco><option timestep="0.005"/><worldbody>
  <geom type="plane" size="5 5 0.1"/>
  <body name="hand" mocap="true" pos="0 0 0.3"><geom type="box" size="0.3 0.3 0.02"/></body>
  <body pos="0.05 0 0.45"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""
TAKERS = {
    "reset": lambda sim, envs: sim.reset(envs),
    "step": lambda sim, envs: sim.step(envs=envs),
    "set_state": lambda sim, envs: sim.set_state(qvel=np.full(sim.model.nv, 0.5), envs=envs),
    "set_state of a State": lambda sim, envs: sim.set_state(sim.get_state(0), envs=envs),
    "randomize": lambda sim, envs: sim.randomize(envs, gravity=None),
    "copy_state": lambda sim, envs: sim.copy_state(0, envs),
    "contacts": lambda sim, envs: sim.contacts(envs),
}
"""Calls that take `envs`, by name."""
ARM = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 .1"><freejoint/><geom name="g" size=".1"/></body>
  <body name="arm"><joint name="j" axis="0 1 0" damping=".1"/><geom type="capsule" fromto="1 0 .5 1.3 0 .5" size=".02"/></body>
  </worldbody><actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator></mujoco>"""
N = 4
EMPTY = {
    "list": [],
    "tuple": (),
    "floats": np.array([]),
    "integers": np.array([], dtype=np.int64),
    "where": np.flatnonzero(np.zeros(N)),
    "mask": np.zeros(N, dtype=bool),
    "masks of Python": [False] * N,
}


def batch(num_envs=7, steps=9, **settings):
    """Environments that are in different states, with delay lines."""
    sim = stepper.Stepper(stepper_model(HOPPER), num_envs, sensors=DELAYED, actuators=DRIVES, **settings)
    for ctrl in np.random.default_rng(1).uniform(-1, 1, (steps, num_envs, sim.model.nu)):
        sim.step(ctrl, nstep=5)
    return sim


def all_of(sim):
    return {name: np.array(getattr(sim, name)) for name in STATE}


def same(found, expected, rows=slice(None), of=None):
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name][rows], value[rows if of is None else of], name)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_environments_go_on_as_their_sources(precision):
    sim, plain = batch(precision=precision), batch(precision=precision)
    sources = np.array([3, 3, 2, 0, 6, 6, 1])
    sim.copy_state(sources)
    same(all_of(sim), all_of(plain), of=sources)
    ctrl = np.random.default_rng(2).uniform(-1, 1, (7, sim.model.nu))
    sim.step(ctrl[sources], nstep=30)
    plain.step(ctrl, nstep=30)
    same(all_of(sim), all_of(plain), of=sources)


def test_one_source_for_some():
    sim, plain = batch(), batch()
    sim.copy_state(4, [0, 2])
    expected = all_of(plain)
    same(all_of(sim), expected, [0, 2], [4, 4])
    same(all_of(sim), expected, [1, 3, 4, 5, 6])
    sim.copy_state([1, 0], [0, 1])  # They change places.
    same(all_of(sim), expected, [0, 1], [1, 4])


def test_some_are_kept_and_given_to_another_stepper():
    sim, other = batch(), batch(4, steps=3)
    untouched = all_of(other)
    kept = pickle.loads(pickle.dumps([sim.get_state(k) for k in (1, 3, 5)]))
    other.set_state([kept[2], kept[0], kept[2]], envs=[3, 1, 0])
    same(all_of(other), all_of(sim), [3, 1, 0], [5, 1, 5])
    same(all_of(other), untouched, [2])
    other.set_state(kept[0])
    same(all_of(other), all_of(sim), of=[1, 1, 1, 1])


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("settings", [
    {"options": stepper.Options()},
    {"options": stepper.Options(contact="mujoco"), "precision": "f32"},
    {"sensors": DELAYED, "actuators": DRIVES},
])  # fmt: skip
def test_a_mask_steps_its_environments_alone(settings, threads):
    """Groups of environments none, some and all of which step: all state is that of a step of all after which the others are put back."""
    sim, twin = (stepper.Stepper(stepper_model(HOPPER), 40, threads=threads, **settings) for _ in range(2))
    rng = np.random.default_rng(5)
    masks = [np.arange(40) < 17, np.arange(40) % 3 == 0, np.zeros(40, bool), np.ones(40, bool), rng.uniform(size=40) < 0.1]
    for mask in masks * 4:
        ctrl = rng.uniform(-1, 1, (40, sim.model.nu))
        held = np.where(mask[:, None], ctrl, twin.ctrl)
        before = twin.get_state()
        twin.step(held, nstep=3)
        twin.set_state(before, envs=~mask)
        sim.step(np.where(mask[:, None], ctrl, np.nan), nstep=3, envs=mask)  # Rows of the others are not read.
        same(all_of(sim), all_of(twin))
        np.testing.assert_array_equal(sim.ctrl, twin.ctrl)
        assert sim.get_state() == twin.get_state()
    assert len(set(sim.time)) > 2


def test_a_mask_moves_the_mocap_bodies_of_its_environments(tmp_path):
    sim, twin = (simulate(stepper.load(HAND_MOVED), 5) for _ in range(2))
    mask = np.array([True, False, True, False, False])
    with twin.record(tmp_path / "run"):  # All step, and the others are put back: it replays.
        for k in range(30):
            for s in (sim, twin):
                s.mocap_pos = np.tile([0.0, 0.0, 0.3 + 0.002 * k], (5, 1, 1))
                s.step(envs=mask)
            assert sim.get_state() == twin.get_state()
    twin.recorder = None
    assert sim.qpos[0, 2] > sim.qpos[1, 2] + 0.02
    twin.step(envs=mask)
    raises(ValueError, "envs has shape", sim.step, envs=mask[:3])


def test_a_rollout_begins_where_it_is_told_to():
    plant, planner = batch(1), batch(5, steps=2)
    ctrl = np.random.default_rng(4).uniform(-1, 1, (6, 5, plant.model.nu))
    found = planner.rollout(ctrl, 2, initial=plant.get_state(0), fields=["qpos", "sensordata"])
    mine = plant.get_state()
    for k in range(5):
        plant.set_state(mine)
        for t in range(6):
            plant.step(ctrl[t, k], nstep=2)
            np.testing.assert_array_equal(found["qpos"][t, k], plant.qpos[0])
            np.testing.assert_array_equal(found["sensordata"][t, k], plant.sensordata[0])
    again = planner.rollout(ctrl, 2, initial=[planner.get_state(k) for k in range(5)][::-1])
    assert again["qpos"].shape == (6, 5, plant.model.nq)


@pytest.mark.parametrize(("call", "error", "said"), [
    (lambda sim: sim.copy_state([0, 1]), ValueError, "sources has 2 environments, must have 7"),
    (lambda sim: sim.copy_state(7), IndexError, "sources has 7, there are environments 0 to 6"),
    (lambda sim: sim.copy_state(0.5), TypeError, "sources has 0.5"),
    (lambda sim: sim.set_state([sim.get_state(0), sim.get_state(1)]), ValueError, "there are 2 states, must be 7"),
    (lambda sim: sim.reset([0, 1], qpos=np.zeros((3, 7))), ValueError, r"qpos has shape \(3, 7\), must be \(2, 7\) or \(7,\)"),
    (lambda sim: sim.reset([0, 1], qpos=np.zeros((2, 3))), ValueError, r"qpos has shape \(2, 3\), must be \(2, 7\)"),
    (lambda sim: sim.reset([0, 1], seed=[1, 2, 3]), ValueError, r"seed has shape \(3,\), must be \(2,\)"),
    (lambda sim: sim.set_state(time=[1.0, 2.0, 3.0], envs=[0, 1]), ValueError, r"time has shape \(3,\), must be \(2,\)"),
    (lambda sim: sim.step(np.zeros((2, 4)), envs=[0, 1, 2]), ValueError, r"ctrl has shape \(2, 4\), must be \(3, 4\)"),
    (lambda sim: sim.randomize([0, 1], gravity=np.zeros((7, 3))), ValueError, r"gravity has shape \(7, 3\), must be \(2, 3\)"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, error, said):
    sim = simulate(stepper_model(HOPPER), 7)
    before = sim.get_state()
    raises(error, said, call, sim)
    assert sim.get_state() == before


def test_nothing_changes_where_a_state_is_of_another_model():
    sim = simulate(stepper_model(HOPPER), 3)
    sim.step(np.random.default_rng(0).uniform(-1, 1, (3, sim.model.nu)), nstep=5)
    assert not np.array_equal(sim.qpos[0], sim.qpos[2])
    before = sim.get_state()
    other = simulate(stepper_model("dm_control/walker"), 3)
    raises(ValueError, r"state 1, of environment 1: .*another", lambda: sim.set_state([sim.get_state(2), other.get_state(0)], envs=[0, 1]))
    assert sim.get_state() == before


@pytest.mark.parametrize("call", TAKERS)
@pytest.mark.parametrize(("envs", "error", "said"), [
    ([0.0, 2.0], TypeError, r"envs has 0\.0, of type float64"),
    ([3, 1, 3], ValueError, "envs has environment 3 more than once"),
    ([1, 7], IndexError, "envs has 7, there are environments 0 to 6"),
    ([-1], IndexError, "envs has -1"),
    ([10**30], IndexError, "envs has 1000000"),
    (np.array([2**63 + 1], np.uint64), IndexError, str(2**63 + 1)),
    ([True, False], ValueError, r"envs has shape \(2,\), must be \(7,\)"),
    ([[1, 2]], ValueError, r"envs has shape \(1, 2\), must be a mask"),
    ("abc", TypeError, "envs has 'abc'"),
])  # fmt: skip
def test_wrong_environments_are_named_by_every_call(call, envs, error, said):
    sim = batch(steps=2)
    before = sim.get_state()
    raises(error, said, lambda: TAKERS[call](sim, envs))
    assert sim.get_state() == before


@given(hypothesis.data())
def test_indices_and_masks_select_the_same(data):
    """Rows for each index, in their order, are the rows of these environments in arrays of all."""
    order = data.draw(hypothesis.lists(hypothesis.integers(0, 6), unique=True, min_size=1))
    kind = data.draw(hypothesis.sampled_from([list, tuple, np.array, lambda x: np.array(x, np.uint8)]))
    one, other = batch(steps=1), batch(steps=1)
    rng = np.random.default_rng(data.draw(hypothesis.integers(0, 99)))
    qvel, ctrl, time = rng.normal(size=(7, one.model.nv)), rng.uniform(-1, 1, (7, one.model.nu)), rng.uniform(size=7)
    gravity, seed, mask = rng.normal(size=(7, 3)), rng.integers(0, 9, 7), np.isin(np.arange(7), order)
    one.reset(kind(order), seed=seed[order])
    one.set_state(qvel=qvel[order], time=time[order], envs=kind(order))
    one.randomize(kind(order), gravity=gravity[order])
    one.step(ctrl[order], envs=kind(order))
    other.reset(mask, seed=seed if mask.any() else None)
    other.set_state(qvel=qvel, time=time, envs=mask)
    other.randomize(mask, gravity=gravity)
    other.step(ctrl, envs=mask)
    assert one.get_state() == other.get_state()
    np.testing.assert_array_equal(one.randomized["gravity"], other.randomized["gravity"])
    assert [int(env) for env in dict.fromkeys(one.contacts(kind(order))["env"].tolist())] == [e for e in order if len(one.contacts(e))]


def test_a_recording_with_indices_replays(tmp_path):
    sim = batch(4, steps=1)
    with sim.record(tmp_path / "run"):
        sim.step(np.full((2, sim.model.nu), 0.3), nstep=2, envs=[3, 1])
        sim.reset([2, 0], qvel=np.full((2, sim.model.nv), 0.1), seed=[5, 6])
        sim.set_state(time=[1.0, 2.0], envs=[3, 0])
        sim.randomize([3, 1], gravity=[[0, 0, -1.0], [0, 0, -2.0]])
        sim.copy_state([0, 0], [2, 3])
        sim.step(nstep=3)
    assert stepper.recording.verify(tmp_path / "run").difference is None


def made(*, recorded=None):
    sim = stepper.Stepper(stepper.load(ARM), N, seed=3)
    sim.step(np.linspace(-1, 1, N)[:, None], 3)
    if recorded is not None:
        sim.record(recorded)
    return sim


def rows(envs, full):
    """Values for a method: a row for each index, or for each environment with a mask."""
    envs = np.asarray(envs)
    return full if envs.dtype == np.bool_ else full[envs.astype(np.int64)]


CALLS = {
    "reset": lambda sim, envs: sim.reset(envs, qpos=rows(envs, np.array(sim.qpos) + 0.5), seed=4),
    "reset to a keyframe": lambda sim, envs: sim.reset(envs=envs),
    "step": lambda sim, envs: sim.step(rows(envs, np.ones((N, 1))), 2, envs=envs),
    "set_state": lambda sim, envs: sim.set_state(rows(envs, np.array(sim.qpos)), rows(envs, np.array(sim.qvel) + 1.0), envs=envs),
    "set_state of a state": lambda sim, envs: sim.set_state(sim.get_state(env=0), envs=envs),
    "set_state of time": lambda sim, envs: sim.set_state(time=rows(envs, np.arange(N) + 1.0), envs=envs),
    "copy_state": lambda sim, envs: sim.copy_state(0, envs),
    "contacts": lambda sim, envs: sim.contacts(envs),
    "randomize": lambda sim, envs: sim.randomize(envs, geom_friction=rows(envs, np.full((N, 3, 3), 0.2))),
    "randomize a selector": lambda sim, envs: sim.randomize({"gravity[2]": -1.0}, envs=envs),
    "randomize rows of a selector": lambda sim, envs: sim.randomize({"body_mass[ball,arm]": rows(envs, np.full((N, 2), 3.0))}, envs=envs),
    "randomize a compound": lambda sim, envs: sim.randomize({"geom_friction[g][0]": rows(envs, np.full(N, 0.5))}, envs=envs),
    "randomize to the model": lambda sim, envs: sim.randomize({"gravity": None}, envs=envs),
    "randomize all": lambda sim, envs: sim.randomize(envs=envs),
}
"""Calls of methods with `envs`; each changes the selected environments."""


def everything(sim):
    """State and parameters of a stepper, as bytes."""
    return repr(
        [np.asarray(getattr(sim, name)).tobytes() for name in ("qpos", "qvel", "time", "ctrl", "status")]
        + sorted((name, np.asarray(values).tobytes()) for name, values in sim.randomized.items())
    )


@every(recorded=[False, True], call=CALLS)
def test_an_empty_selection_changes_nothing(call, recorded, tmp_path):
    sim = made(recorded=tmp_path / "run" if recorded else None)
    before = everything(sim)
    for envs in EMPTY.values():
        result = CALLS[call](sim, envs)
        assert result is None or len(result) == 0
        assert everything(sim) == before


@pytest.mark.parametrize("call", CALLS)
def test_a_mask_selects_what_its_indices_do(call):
    one, other, mask = made(), made(), np.array([True, False, False, True])
    found = CALLS[call](one, mask), CALLS[call](other, np.flatnonzero(mask))
    assert everything(one) == everything(other)
    if found[0] is not None:
        np.testing.assert_array_equal(*found)


def test_all_methods_with_envs_are_tested():
    methods = {name for name in dir(stepper.Stepper) if not name.startswith("_") and callable(getattr(stepper.Stepper, name))}
    with_envs = {name for name in methods if "envs" in inspect.signature(getattr(stepper.Stepper, name)).parameters}
    assert with_envs == {call.split()[0] for call in CALLS}


@pytest.mark.parametrize("envs", EMPTY.values(), ids=EMPTY)
def test_environments_take_an_empty_selection(envs):
    batch = StepperVectorEnv("HalfCheetah", N)
    observation, _ = batch.reset(seed=0)
    with_indices = np.asarray(envs).dtype != np.bool_
    np.testing.assert_array_equal(batch.reset(envs=envs)[0], observation)
    np.testing.assert_array_equal(batch.reset(envs=envs, seed=[] if with_indices else [None] * N)[0], observation)
    shape = (0, 9) if with_indices else (N, 9)
    np.testing.assert_array_equal(batch.set_state(np.ones(shape), np.ones(shape), envs=envs), observation)


@pytest.mark.parametrize("envs", EMPTY.values(), ids=EMPTY)
def test_drives_of_no_environment_are_empty(envs):
    assert stepper.ActuatorModel({"m": stepper.Drive(delay=np.arange(N) * 0.01)}).drives(made().model, N, envs)[0]["delay"] == []


def test_a_view_shows_the_environments_of_a_mask():
    sim = made()
    assert shown_envs(sim, np.array([True, False, False, True]), 16).tolist() == [0, 3]
    assert shown_envs(sim, [2, 0], 16).tolist() == [2, 0]
    assert shown_envs(sim, 2, 16).tolist() == [0, 1]
    for envs in EMPTY.values():
        raises(ValueError, "envs selects no environment", shown_envs, sim, envs, 16)
