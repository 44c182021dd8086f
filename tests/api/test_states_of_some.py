"""States of some environments by their indices: what is copied, kept, given away, reset and stepped, and what stays as it is."""

import pickle

import numpy as np
import pytest
import stepper
from models import STATE, simulate, stepper_model
from stepper import states

HOPPER = "dm_control/hopper"
DELAYED = stepper.SensorModel(default=stepper.Transfer(delay=0.013))
DRIVES = stepper.ActuatorModel(default=stepper.Drive(delay=0.017, lag=0.02))


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
    states.copy(sim, sources)
    same(all_of(sim), all_of(plain), of=sources)
    ctrl = np.random.default_rng(2).uniform(-1, 1, (7, sim.model.nu))
    sim.step(ctrl[sources], nstep=30)
    plain.step(ctrl, nstep=30)
    same(all_of(sim), all_of(plain), of=sources)


def test_one_source_for_some():
    sim, plain = batch(), batch()
    states.copy(sim, 4, [0, 2])
    expected = all_of(plain)
    same(all_of(sim), expected, [0, 2], [4, 4])
    same(all_of(sim), expected, [1, 3, 4, 5, 6])
    states.copy(sim, [1, 0], [0, 1])  # They change places.
    same(all_of(sim), expected, [0, 1], [1, 4])


def test_some_are_kept_and_given_to_another_stepper():
    sim, other = batch(), batch(4, steps=3)
    untouched = all_of(other)
    kept = pickle.loads(pickle.dumps(states.save(sim, slice(1, 6, 2))))
    assert kept == [sim.get_state(k) for k in (1, 3, 5)]
    states.restore(other, [kept[2], kept[0], kept[2]], [3, 1, 0])
    same(all_of(other), all_of(sim), [3, 1, 0], [5, 1, 5])
    same(all_of(other), untouched, [2])
    states.restore(other, kept[0])
    same(all_of(other), all_of(sim), of=[1, 1, 1, 1])


def test_some_are_reset_by_their_indices():
    sim, masked = batch(), batch()
    qpos = np.tile(sim.model.qpos0, (2, 1))
    qpos[:, 1] += [0.1, 0.2]
    states.reset(sim, [5, 2], qpos=qpos, qvel=np.full(sim.model.nv, 0.3), seed=[8, 9])
    every = np.zeros((7, sim.model.nq))
    every[:], every[[5, 2]] = sim.model.qpos0, qpos
    seeds = np.zeros(7, dtype=np.int64)
    seeds[[5, 2]] = 8, 9
    masked.reset(np.isin(np.arange(7), [2, 5]), qpos=every, qvel=np.full(sim.model.nv, 0.3), seed=seeds)
    assert sim.get_state() == masked.get_state()
    assert sim.qpos[5, 1] != sim.qpos[2, 1]


def test_some_are_stepped_and_the_others_stay():
    sim, plain = batch(), batch()
    before = all_of(sim)
    ctrl = np.random.default_rng(3).uniform(-1, 1, (3, sim.model.nu))
    every = np.array(plain.ctrl)
    every[[6, 0, 3]] = ctrl
    states.step(sim, ctrl, [6, 0, 3], nstep=4)
    plain.step(every, nstep=4)
    same(all_of(sim), all_of(plain), [6, 0, 3])
    same(all_of(sim), before, [1, 2, 4, 5])
    states.step(sim, None, np.arange(7) != 1)  # The others hold theirs.
    plain.step()
    same(all_of(sim), all_of(plain), [6, 0, 3])
    same(all_of(sim), before, [1])


HAND_MOVED = """
<mujoco><option timestep="0.005"/><worldbody>
  <geom type="plane" size="5 5 0.1"/>
  <body name="hand" mocap="true" pos="0 0 0.3"><geom type="box" size="0.3 0.3 0.02"/></body>
  <body pos="0.05 0 0.45"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""


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
        twin.set_state(before, mask=~mask)
        sim.step(np.where(mask[:, None], ctrl, np.nan), nstep=3, mask=mask)  # Rows of the others are not read.
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
                states.step(s, None, mask)
            assert sim.get_state() == twin.get_state()
        with pytest.raises(ValueError, match=r"stepper\.states\.step\(sim, ctrl, mask\) is recorded"):
            twin.step(mask=mask)
    twin.recorder = None
    assert sim.qpos[0, 2] > sim.qpos[1, 2] + 0.02
    twin.step(mask=mask)
    with pytest.raises(ValueError, match="mask has shape"):
        sim.step(mask=mask[:3])
    with pytest.raises(ValueError, match="mask has dtype int64, must be bool"):
        sim.step(mask=np.arange(5))


def test_a_rollout_begins_where_it_is_told_to():
    plant, planner = batch(1), batch(5, steps=2)
    ctrl = np.random.default_rng(4).uniform(-1, 1, (6, 5, plant.model.nu))
    found = states.rollout(planner, ctrl, 2, initial=plant.get_state(0), fields=["qpos", "sensordata"])
    mine = plant.get_state()
    for k in range(5):
        plant.set_state(mine)
        for t in range(6):
            plant.step(ctrl[t, k], nstep=2)
            np.testing.assert_array_equal(found["qpos"][t, k], plant.qpos[0])
            np.testing.assert_array_equal(found["sensordata"][t, k], plant.sensordata[0])
    again = states.rollout(planner, ctrl, 2, initial=states.save(planner)[::-1])
    assert again["qpos"].shape == (6, 5, plant.model.nq)


@pytest.mark.parametrize(("call", "error", "said"), [
    (lambda sim: states.copy(sim, [0, 1]), ValueError, r"sources has shape \(2,\), must be one index or \(7,\)"),
    (lambda sim: states.copy(sim, 7), IndexError, "sources has 7, there are environments 0 to 6"),
    (lambda sim: states.copy(sim, 0.5), TypeError, "whole numbers"),
    (lambda sim: states.save(sim, [1, 1]), ValueError, "environment 1 more than once"),
    (lambda sim: states.save(sim, [-1]), IndexError, "envs has -1"),
    (lambda sim: states.save(sim, [True, False]), ValueError, r"mask of shape \(2,\), must be \(7,\)"),
    (lambda sim: states.restore(sim, states.save(sim, [0, 1])), ValueError, "there are 2 states, must be 7"),
    (lambda sim: states.reset(sim, [0, 1], qpos=np.zeros((3, 7))), ValueError, "must have 2 rows"),
    (lambda sim: states.reset(sim, [0, 1], qpos=np.zeros((2, 3))), ValueError, r"rows of shape \(3,\), must have \(7,\)"),
    (lambda sim: states.step(sim, np.zeros((2, 4)), [0, 1, 2]), ValueError, "must have 3 rows"),
    (lambda sim: states.save(stepper.Stepper(sim.model)), ValueError, "no axis of environments"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, error, said):
    sim = simulate(stepper_model(HOPPER), 7)
    before = sim.get_state()
    with pytest.raises(error, match=said):
        call(sim)
    assert sim.get_state() == before


def test_nothing_changes_where_a_state_is_of_another_model():
    sim = simulate(stepper_model(HOPPER), 3)
    sim.step(np.random.default_rng(0).uniform(-1, 1, (3, sim.model.nu)), nstep=5)
    assert not np.array_equal(sim.qpos[0], sim.qpos[2])
    before = sim.get_state()
    other = simulate(stepper_model("dm_control/walker"), 3)
    with pytest.raises(ValueError, match="state 1 is of another model"):
        states.restore(sim, [sim.get_state(2), other.get_state(0)], [0, 1])
    assert sim.get_state() == before
