"""Episodes and states: what a reset ends, what a step holds, what a state has, and who can be given it."""

import numpy as np
import pytest
import stepper
from checks import every, raises
from models import STATE, simulate, stepper_model

HOPPER, HUMANOID = "dm_control/hopper", "dm_control/humanoid"
MOCAP = """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"><geom size=".1"/></body>
  <body name="arm" pos="1 0 1"><joint name="hinge" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>
  <actuator><general joint="hinge" gainprm="2"/><general joint="hinge" dyntype="filter" dynprm=".1"/></actuator>
  <sensor><actuatorfrc actuator="0"/><jointactuatorfrc joint="hinge"/></sensor>
  <keyframe><key name="up" time="1.5" qpos=".7" qvel="-.3" act=".25" ctrl=".5 -.5"/><key qpos="-1"/></keyframe></mujoco>""".replace(
    'actuator="0"', 'actuator="direct"'
).replace('<general joint="hinge" gainprm="2"/>', '<general name="direct" joint="hinge" gainprm="2"/>')
DELAYED = stepper.SensorModel(default=stepper.Transfer(delay=0.013, bias_std=0.1, noise_std=0.01))
DRIVES = stepper.ActuatorModel(default=stepper.Drive(delay=0.017, lag=0.02))


def whole(num_envs=4, seed=1):
    """A batch with everything that remembers: delay lines of sensors and actuators, noise, contacts."""
    return stepper.Stepper(stepper_model(HOPPER), num_envs, sensors=DELAYED, actuators=DRIVES, seed=seed)


def controls(sim, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, sim.num_envs or 1, sim.model.nu))


def run(sim, steps, seed=0):
    for ctrl in controls(sim, steps, seed):
        sim.step(ctrl if sim.num_envs else ctrl[0])
    return sim


# Resets


def test_a_push_does_not_leak_into_the_next_episode():
    """Forces that were applied and mocap bodies that were moved are as in a new stepper, in the environments that were reset alone."""
    model = stepper.load(MOCAP)
    sim, new = (stepper.Stepper(model, 3) for _ in range(2))
    sim.qfrc_applied[:], sim.xfrc_applied[:] = 5.0, 7.0
    sim.mocap_pos[:] = 9.0
    mine = sim.xfrc_applied
    sim.step(np.ones(2))
    mask = np.array([True, False, True])
    sim.reset(mask)
    for name in ("qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat"):
        assert np.array_equal(getattr(sim, name)[mask], getattr(new, name)[mask]), name
    assert np.all(sim.xfrc_applied[1] == 7.0)
    assert np.all(sim.mocap_pos[1] == 9.0)
    assert mine is sim.xfrc_applied
    sim.step()
    new.step()
    assert np.array_equal(sim.qpos[mask], new.qpos[mask])
    assert np.array_equal(sim.sensordata_ideal[mask], new.sensordata_ideal[mask])


def test_a_reset_environment_is_a_new_one_in_all_that_remembers():
    """Delay lines, lags, drift, contacts, flags, counters, held controls: but for the episode that random numbers belong to."""
    quiet = stepper.SensorModel(default=stepper.Transfer(delay=0.013))
    sim, new = (stepper.Stepper(stepper_model(HOPPER), 4, sensors=quiet, actuators=DRIVES) for _ in range(2))
    run(sim, 30)
    sim.xfrc_applied[:, 1, 2] = 10.0
    sim.step(np.full(sim.model.nu, np.nan))
    sim.reset()
    for name in STATE:
        assert np.array_equal(getattr(sim, name), getattr(new, name)), name
    run(sim, 20, seed=5)
    run(new, 20, seed=5)
    assert np.array_equal(sim.qpos, new.qpos)
    assert np.array_equal(sim.sensordata, new.sensordata)


def test_a_replay_has_resets_that_end_what_was_applied(tmp_path):
    sim = stepper.Stepper(stepper.load(MOCAP), 3)
    with sim.record(tmp_path / "run"):
        for k in range(6):
            sim.xfrc_applied[:, 2, 2] = 3.0
            sim.step(np.ones(2))
            sim.reset(np.arange(3) == k % 3, keyframe=1 if k % 2 else "up")
            sim.step(nstep=2)
            sim.set_state(qvel=[0.1], keep_warmstart=True, time=float(k))
    assert stepper.recording.verify(tmp_path / "run")


# Controls


def test_a_step_without_controls_holds_the_last():
    sim = simulate(stepper_model(HUMANOID), 2)
    other = simulate(stepper_model(HUMANOID), 2)
    sim.step(np.full(21, 0.3))
    sim.step(nstep=3)
    other.step(np.full(21, 0.3), nstep=4)
    assert np.all(sim.ctrl == 0.3)
    assert np.array_equal(sim.qpos, other.qpos)
    sim.rollout(np.full((2, 21), -0.2))
    sim.step()
    other.rollout(np.full((3, 21), -0.2))
    assert np.array_equal(sim.qpos, other.qpos)
    assert sim.get_state() == other.get_state()
    sim.reset()
    assert not sim.ctrl.any()


def test_a_keyframe_brings_its_controls():
    model = stepper.load(MOCAP)
    sim, told = stepper.Stepper(model, 2), stepper.Stepper(model, 2)
    sim.reset([False, True], keyframe="up")
    assert sim.ctrl.tolist() == [[0, 0], [0.5, -0.5]]
    found = [sim.qpos.ravel(), sim.qvel.ravel(), sim.act.ravel(), sim.time]
    assert np.transpose(found).tolist() == [[0, 0, 0, 0], [0.7, -0.3, 0.25, 1.5]]
    assert sim.sensordata_ideal[1].tolist() == pytest.approx([1.0, 1.25])
    told.reset([False, True], keyframe="up")
    sim.step()
    told.step([[0, 0], [0.5, -0.5]])
    assert np.array_equal(sim.qpos, told.qpos)
    sim.reset(keyframe=1)
    assert sim.qpos.ravel().tolist() == [-1, -1]
    for keyframe, said in ((2, "up, 1"), ("sideways", "'sideways', there are: up")):
        raises(KeyError, said, sim.reset, keyframe=keyframe)


# States


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_state_of_one_environment_can_be_given_to_many(precision):
    """A plant alone, a planner with many: each goes on with the bits of the plant, whatever its delay lines had seen before."""
    model, drives = stepper_model(HOPPER), DRIVES
    quiet = stepper.SensorModel(default=stepper.Transfer(delay=0.013))
    plant = run(stepper.Stepper(model, sensors=quiet, actuators=drives, precision=precision), 23)
    planner = run(stepper.Stepper(model, 20, sensors=quiet, actuators=drives, precision=precision), 8)
    untouched = run(stepper.Stepper(model, 20, sensors=quiet, actuators=drives, precision=precision), 8)
    mask = np.arange(20) % 3 == 1
    planner.set_state(plant.get_state(), envs=mask)
    for ctrl in controls(plant, 15, seed=2)[:, 0]:
        for sim in (plant, planner, untouched):
            sim.step(ctrl)
    for name in ("qpos", "qvel", "ctrl", "time", "residual", "sensordata", "max_penetration"):
        found = getattr(planner, name)
        assert all(np.array_equal(row, getattr(plant, name)) for row in found[mask]), name
        assert np.array_equal(found[~mask], getattr(untouched, name)[~mask]), name
    planner.set_state(plant.get_state())
    assert all(np.array_equal(row, plant.qpos) for row in planner.qpos)


def test_nothing_of_an_environment_with_more_contacts_is_left_to_one_with_fewer():
    """What an environment in the air takes the place of, by a state or a reset, has contacts that it has not."""
    model = stepper_model(HUMANOID)
    sim, fresh = simulate(model, 5), simulate(model, 5)
    sim.step(nstep=400)
    assert all(len(sim.contacts(env)) > 2 for env in range(5))
    air = simulate(model, 5)
    air.step(np.full(21, 0.2), nstep=3)
    assert len(air.contacts()) == 0
    mask = np.array([False, True, False, True, True])
    sim.set_state(air.get_state(env=0), envs=mask)
    assert sim.get_state(env=3) == air.get_state(env=3)
    sim.reset(~mask)
    assert sim.get_state(env=0) == fresh.get_state(env=0)
    for s in (sim, air, fresh):
        s.step(np.full(21, 0.1), nstep=400)
    assert len(air.contacts()) > 0
    assert all(sim.get_state(env=env) == air.get_state(env=env) for env in (1, 3, 4))
    assert all(sim.get_state(env=env) == fresh.get_state(env=env) for env in (0, 2))


def test_a_state_that_does_not_fit_says_what_would():
    raises(ValueError, r"5 environments, this stepper has 4.*or of one for all", lambda: whole(4).set_state(whole(5).get_state()))
    raises(ValueError, "accepts only envs as a further argument", lambda: whole(4).set_state(whole(4).get_state(), qvel=np.zeros(7)))


def test_time_is_set():
    sim = simulate(stepper_model(HUMANOID), 3, steps=1)
    state = sim.qpos
    sim.set_state(time=[1.0, 2.0, 3.0])
    sim.set_state(time=9.0, envs=[False, True, False])
    assert sim.time.tolist() == [1.0, 9.0, 3.0]
    assert np.array_equal(sim.qpos, state)
    raises(ValueError, "time of environment 1 is NaN", sim.set_state, time=[0.0, np.nan, 0.0])
    raises(ValueError, r"time has shape \(2,\), must be \(3,\) or \(\)", sim.set_state, time=[0.0, 1.0])


def test_a_cold_start_forgets_what_a_correction_keeps():
    """Delay lines: an observer that corrects its state goes on as its plant, one that starts cold does not."""
    plant, warm, cold = (run(whole(), 20) for _ in range(3))
    for sim, kept in [(warm, True), (cold, False)]:
        sim.set_state(plant.qpos, plant.qvel, keep_warmstart=kept)
    assert warm.residual.any() and not cold.residual.any()
    for sim in (plant, warm, cold):
        sim.step(np.full(4, -1.0))
    assert np.array_equal(warm.qpos, plant.qpos)
    assert np.array_equal(warm.sensordata, plant.sensordata)
    assert np.abs(cold.qvel - plant.qvel).max() > 1e-6


@every(contact=["hard", "mujoco"], num_envs=[1, 11])
def test_contacts_of_a_state_that_was_set_are_those_of_the_next_step(contact, num_envs):
    """Like the forces of sensors and bodies; an environment whose state was not set keeps the contacts of its last step."""
    model = stepper.load("""<mujoco><worldbody><geom type="plane" size="5 5 .1"/><body pos="0 0 .1"><freejoint/>
      <geom type="box" size=".1 .2 .1"/></body></worldbody></mujoco>""")
    sim = stepper.Stepper(model, num_envs, options=stepper.Options(contact=contact))
    qpos = np.tile(model.qpos0, (num_envs, 1))
    qpos[:, 2] -= np.linspace(1e-4, 1e-3, num_envs)
    qpos[num_envs // 2, 2] = 3.0 if num_envs > 1 else qpos[0, 2]
    before = sim.contacts()
    sim.set_state(qpos=qpos)
    state, found, forces = sim.get_state(), sim.contacts(), sim.body_contact_force[:, 1, 2]
    assert sim.get_state() == state
    np.testing.assert_array_equal(sim.contacts(), found)
    on_body = np.bincount(found["env"], (found["force"][:, None] @ found["frame"])[:, 0, 2], minlength=num_envs)
    # Rounding of a sum of four forces.
    np.testing.assert_allclose(on_body, forces, rtol=1e-12, atol=1e-12)
    sim.step()
    np.testing.assert_array_equal(sim.contacts(), found)
    assert len(before)
    sim.set_state(qpos=model.qpos0, envs=[0])
    kept = found["env"] > 0
    np.testing.assert_array_equal(sim.contacts()[-kept.sum() or len(found) :], found[kept])


def test_a_call_without_steps_sets_the_controls():
    model = stepper.load("""<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
      <actuator><motor joint="a"/></actuator></mujoco>""")
    sim, other = stepper.Stepper(model, 3), stepper.Stepper(model, 3)
    ctrl = np.array([[1.0], [2.0], [3.0]])
    sim.step(ctrl, nstep=0)
    np.testing.assert_array_equal(sim.ctrl, ctrl)
    assert not sim.time.any()
    sim.step([[5.0]], 0, envs=[1])
    ctrl[1] = 5.0
    assert sim.qacc_smooth[1] == 5 * sim.qacc_smooth[0] > 0
    sim.step()
    other.step(ctrl)
    np.testing.assert_array_equal(sim.qvel, other.qvel)
