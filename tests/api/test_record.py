"""Recordings: replayed bit for bit across threads and precisions, refused for another model, and read for what failed."""

import itertools
import json
import tracemalloc

import numpy as np
import pytest
import stepper
from bench_episode import EPISODE, record
from checks import every, raises
from models import simulate, stepper_model
from recordings import PENDULUM, edit_file, edit_header, joined
from stepper.recording.format import FORMAT, find_blocks, read_header

ROBOT = "gymnasium/ant"
N, STEPS = 5, 30
ARM = """
<mujoco><option timestep="0.002" gravity="0 0 0"/>
  <worldbody><body><joint name="a" axis="0 1 0" actuatorfrcrange="-3 3"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <body><joint name="b" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody>
  <actuator><motor name="plain" joint="a" forcerange="-2 2"/><motor name="driven" joint="b"/><position name="servo" joint="b" kp="100"
  forcerange="-1 1"/><motor name="second" joint="a"/></actuator></mujoco>"""
RENEW = "renew it: PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/bench_episode.py; and adapt benches/src/replay.rs"


def run(path, *, num_envs=N, precision="f64", threads=1, **settings):
    """A run with everything that a run can have: control, resets, states, applied forces."""
    sim = simulate(stepper_model(ROBOT), num_envs, precision=precision, threads=threads, seed=3, steps=7)
    rng, shape = np.random.default_rng(0), () if num_envs is None else (num_envs,)
    with sim.record(path, **settings):
        for k in range(STEPS):
            sim.step(rng.uniform(-1, 1, (*shape, sim.model.nu)), nstep=1 + k % 2)
            if k == 7:
                sim.xfrc_applied[..., 1, 2] = 30.0
            if k == 11:
                kept = sim.get_state()
            if k == 13:
                sim.reset(None if num_envs is None else np.arange(num_envs) % 2 == 0, seed=9)
            if k == 17:
                sim.set_state(kept)
            if k == 19:
                sim.set_state(qvel=np.full(sim.model.nv, 0.1))
    return sim


@every(precision=["f64", "f32"], num_envs=[None, N])
def test_a_replay_reproduces_every_bit(tmp_path, precision, num_envs):
    run(tmp_path / "run", precision=precision, num_envs=num_envs)
    for threads in (None, 2):
        result = stepper.recording.verify(tmp_path / "run", threads=threads)
        assert result
        assert (result.steps, result.complete, result.difference) == (STEPS, True, None)
        assert "bit for bit" in str(result)


@pytest.mark.parametrize("what", ["step", "reset", "set_state", "randomize"])
def test_arrays_that_are_written_again_after_a_call_were_kept(tmp_path, what):
    """Loops fill one array anew for every call, and rows are written later."""
    sim = stepper.Stepper(stepper_model(ROBOT), N)
    qpos, qvel, ctrl = sim.qpos.copy(), sim.qvel.copy(), np.zeros((N, sim.model.nu))
    gravity, mask = np.tile(sim.model.gravity, (N, 1)), np.zeros(N, dtype=bool)
    with sim.record(tmp_path / "run"):
        for k in range(5):
            ctrl[:], qpos[:, 2], qvel[:], gravity[:, 2], mask[:] = 0.1 * k, 1 + 0.1 * k, 0.1 * k, -k, np.arange(N) == k
            sim.step(ctrl)
            if what == "reset":
                sim.reset(mask, qpos=qpos, qvel=qvel)
            elif what == "set_state":
                sim.set_state(qpos, qvel, envs=mask)
            elif what == "randomize":
                sim.randomize(mask, gravity=gravity)
    assert stepper.recording.verify(tmp_path / "run")


@pytest.mark.parametrize("field", ["qvel", "max_penetration", "max_limit_violation"])
def test_a_difference_is_named_by_step_field_and_environment(tmp_path, field):
    run(tmp_path / "run")
    edit_file(tmp_path / "run", lambda arrays: arrays[field].__setitem__((12, 3), np.nextafter(arrays[field][12, 3], 9.0)))
    difference = stepper.recording.verify(tmp_path / "run").difference
    assert (difference.step, difference.field, difference.env) == (12, field, 3)
    assert not np.array_equal(difference.recorded, difference.replayed)
    assert "call 12" in str(difference)
    assert "environment 3" in str(difference)


@pytest.mark.parametrize(("precision", "given", "tolerance"), [("f64", None, 1e-4), ("f32", None, 1e-4), ("f64", 1e-3, 1e-3)])
def test_a_recording_says_the_tolerance_in_force_and_keeps_a_note(tmp_path, precision, given, tolerance):
    sim = stepper.Stepper(stepper_model(ROBOT), options=stepper.Options(tolerance=given), precision=precision)
    with sim.record(tmp_path / "run", note="third gripper, dry"):
        sim.step()
    head = json.loads((tmp_path / "run/run.json").read_text())
    assert (head["tolerance"], head["note"]) == (tolerance, "third gripper, dry")
    assert sim.tolerance == tolerance


def test_another_model_is_refused(tmp_path):
    run(tmp_path / "run").model.replace(timestep=0.003).save(tmp_path / "run/model.stepper")
    raises(ValueError, "recorded with model", stepper.recording.verify, tmp_path / "run")


def cut_the_rows(folder):
    file = folder / "rows.bin"
    file.write_bytes(file.read_bytes()[:-40])


def cut_a_block(folder):
    """At the end of a block, so that the rest is whole."""
    file = folder / "rows.bin"
    file.write_bytes(file.read_bytes()[: find_blocks(folder, read_header(folder))[-2].end])


def swap_two_blocks(folder):
    """Of the same numbers of rows and bytes."""
    data = (folder / "rows.bin").read_bytes()
    blocks = find_blocks(folder, read_header(folder))
    parts = [data[before.end : block.end] for before, block in itertools.pairwise(blocks)]
    parts[1], parts[2] = parts[2], parts[1]
    (folder / "rows.bin").write_bytes(data[: blocks[0].end] + b"".join(parts))


def flip_a_bit(folder):
    data = bytearray((folder / "rows.bin").read_bytes())
    data[len(data) // 2] ^= 4
    (folder / "rows.bin").write_bytes(data)


def edit_the_options(folder):
    text = (folder / "run.json").read_text()
    assert '"iterations": 50' in text
    (folder / "run.json").write_text(text.replace('"iterations": 50', '"iterations": 49'))


@pytest.mark.parametrize(("damage", "place"), [
    (lambda folder: (folder / "rows.bin").unlink(), r"there is no rows file .*rows.bin"),
    (lambda folder: (folder / "rows.bin").write_bytes(b""), r"rows.bin: it has 0 bytes, run.json counts \d+: it was truncated"),
    (cut_the_rows, r"rows.bin: it has \d+ bytes, run.json counts \d+: it was truncated or replaced; copy the recording again"),
    (cut_a_block, r"rows.bin: it has \d+ bytes, run.json counts \d+: it was truncated or replaced; copy the recording again"),
    (swap_two_blocks, r"rows.bin, row \d+: the rows are not those that were recorded"),
    (flip_a_bit, r"rows.bin, row \d+: the rows are not those that were recorded"),
    (edit_the_options, "run.json: its contents do not match its SHA-256"),
    (lambda folder: (folder / "run.json").write_text("[1"), "run.json: "),
    (lambda folder: (folder / "run.json").write_text("[1]"), "run.json: the contents are not those of a recording"),
    (lambda folder: (folder / "run.json").write_text("{}"), "has format None of recordings"),
    (lambda folder: (folder / "run.json").write_bytes(b"\xff\xfe{}"), "run.json: "),
    (lambda folder: (folder / "model.stepper").write_bytes(b"stepper\xff"), "model.stepper: .*cut off"),
])  # fmt: skip
def test_a_recording_that_was_cut_swapped_or_edited_is_refused_with_the_place(tmp_path, damage, place):
    run(tmp_path / "run", chunk=10_000)
    assert stepper.recording.verify(tmp_path / "run")
    damage(tmp_path / "run")
    raises((stepper.recording.RecordingError, FileNotFoundError), place, stepper.recording.verify, tmp_path / "run")


@every(key=["options", "num_envs", "precision", "seed", "closed", "steps", "size", "digest", "rows", "provenance", "model", "threads"])
@pytest.mark.parametrize("value", ["missing", None, -1, "x", [], {}, 1e300])
def test_a_header_that_lacks_something_or_has_nonsense_is_one_documented_error(tmp_path, key, value):
    """Behind a checksum that is right."""
    sim = stepper.Stepper(stepper.load(PENDULUM))
    with sim.record(tmp_path / "run"):
        sim.step()
    edit_header(tmp_path / "run", lambda head: head.pop(key) if value == "missing" else head.update({key: value}))
    if (key, value) in [("num_envs", None)]:
        assert stepper.recording.verify(tmp_path / "run")
        return
    raises(stepper.recording.RecordingError, "run", stepper.recording.verify, tmp_path / "run")


@pytest.mark.parametrize("change", [
    lambda arrays: arrays.pop("kind"),
    lambda arrays: arrays.update(kind=np.array([0, 9], np.uint8)),
    lambda arrays: arrays.update(kind=np.array([0, 2], np.uint8)),
    lambda arrays: arrays.update(kind=np.array(["a", "b"])),
    lambda arrays: arrays.pop("ctrl"),
    lambda arrays: arrays.pop("max_penetration"),
    lambda arrays: arrays.update(qpos=arrays["qpos"][:0]),
    lambda arrays: arrays.update(qpos=arrays["qpos"][..., :0]),
    lambda arrays: arrays.update(nstep=np.array([-1])),
    lambda arrays: arrays.update(nstep=np.array([np.nan])),
    lambda arrays: arrays.update(ctrl=np.array([["x"]])),
    lambda arrays: arrays.pop("0/state"),
    lambda arrays: arrays.update({"0/state": arrays["0/state"][:-1]}),
    lambda arrays: arrays.update({"0/randomized/body_mass": np.ones((1, 9))}),
    lambda arrays: arrays.update({"0/randomized/body_weight": np.ones((1, 2))}),
    lambda arrays: arrays.update({"0/actuators": np.array("{")}),
])  # fmt: skip
def test_rows_that_lack_something_or_have_nonsense_are_one_documented_error(tmp_path, change):
    """Behind checksums that are right."""
    sim = stepper.Stepper(stepper.load(PENDULUM))
    with sim.record(tmp_path / "run"):
        sim.step()
    edit_file(tmp_path / "run", change)
    raises(stepper.recording.RecordingError, r"rows\.bin", stepper.recording.verify, tmp_path / "run")


@pytest.mark.parametrize("name", ["/tmp/model.stepper", "../model.stepper", "a/model.stepper", "", "other.stepper", None])
def test_the_model_of_a_recording_lies_in_its_folder(tmp_path, name):
    run(tmp_path / "run").model.save(tmp_path / "model.stepper")
    edit_header(tmp_path / "run", lambda head: head["model"].update(file=name))
    with pytest.raises(stepper.recording.RecordingError, match=r"run.json: model.file is .* must be 'model.stepper'"):
        stepper.recording.verify(tmp_path / "run")


def test_what_replay_is_given_wrongly_is_not_laid_to_the_recording(tmp_path):
    run(tmp_path / "run")
    with pytest.raises(ValueError, match="threads is -1") as error:
        stepper.recording.verify(tmp_path / "run", threads=-1)
    assert not isinstance(error.value, stepper.recording.RecordingError)
    with pytest.raises(FileNotFoundError):
        stepper.recording.verify(tmp_path / "nothing")


def test_one_recording_at_a_time_into_an_empty_folder(tmp_path):
    sim = stepper.Stepper(stepper_model(ROBOT))
    with sim.record(tmp_path / "run"), pytest.raises(ValueError, match="already being recorded"):
        sim.record(tmp_path / "other")
    raises(FileExistsError, "not empty", sim.record, tmp_path / "run")
    assert sim.recorder is None


def test_failures_of_sensing_are_counted_by_sensor():
    """Saturation is known from the truth; lost samples from readings of the clock, which stand still."""
    text = PENDULUM.replace("</sensor>", '<clock name="clock"/></sensor>')
    sensors = stepper.SensorModel({"gyro": stepper.Transfer(limits=(-0.5, 0.5)), "clock": stepper.Transfer(dropout=0.3)})
    sim = stepper.Stepper(stepper.load(text), 4, sensors=sensors)
    beyond, still, steps, before = np.zeros(4, int), np.zeros(4, int), 300, np.zeros(4)
    sim.reset(qpos=[[0.0], [0.05], [1.0], [2.0]])
    for _ in range(steps):
        sim.step()
        saturated = np.any(np.abs(sim.sensordata_ideal[:, 1:4]) > 0.5, axis=1)
        beyond += saturated
        lost = sim.sensordata[:, 7] == before
        still += lost
        before = sim.sensordata[:, 7]
        np.testing.assert_array_equal(sim.sensor_faults[:, 1], np.stack([saturated, np.zeros(4)], axis=1))
        np.testing.assert_array_equal(sim.sensor_faults[:, 3, 1], lost)
    last = sim.sensor_faults
    assert last.shape == (4, 4, 2)
    assert not last[:, [0, 2]].any()
    # Many steps in a call are counted one by one.
    sim.step(nstep=50)
    assert sim.sensor_faults[3, 1, 0] > 40
    assert beyond[0] == beyond[1] == 0 < min(beyond[2:])
    # Five standard deviations of a binomial number.
    assert abs(still.sum() - 0.3 * 4 * steps) < 5 * np.sqrt(0.21 * 4 * steps)


@every(integrator=["midpoint", "implicit", "euler"], num_envs=[1, 11])
def test_efforts_at_their_bounds_are_counted_by_actuator(integrator, num_envs):
    drives = stepper.ActuatorModel({"driven": stepper.Drive(motor=stepper.actuators.DCMotor(stall_torque=4.0, no_load_speed=50.0))})
    sim = stepper.Stepper(stepper.load(ARM), num_envs, actuators=drives, options=stepper.Options(integrator=integrator))

    def counts(*ctrl, nstep=3):
        sim.reset()
        sim.step(np.tile(ctrl, (num_envs, 1)).astype(float), nstep=nstep)
        assert sim.actuator_saturation.shape == (num_envs, 4)
        assert np.ptp(sim.actuator_saturation, axis=0).max() == 0
        return sim.actuator_saturation[0].tolist()

    assert counts(1.9, 3.9, 0.005, 0.0) == [0, 0, 0, 0]
    assert counts(2.1, 0.0, 0.0, 0.0) == [3, 0, 0, 0]
    assert counts(0.0, 5.0, 0.0, 0.0) == [0, 3, 0, 0]
    assert counts(0.0, 0.0, -0.5, 0.0, nstep=2) == [0, 0, 2, 0]
    # The joint's bound is that of the sum: both are cut.
    assert counts(1.5, 0.0, 0.0, 2.0) == [3, 0, 0, 3]
    sim.reset()
    assert not sim.actuator_saturation.any()


def test_a_recording_needs_no_more_memory_the_longer_it_is(tmp_path):
    sim = stepper.Stepper(stepper_model(ROBOT), 4)
    peaks = []
    with sim.record(tmp_path / "run", chunk=50_000):
        sim.step(nstep=1)
        tracemalloc.start()
        for _ in range(4):
            tracemalloc.reset_peak()
            for _ in range(150):
                sim.step(nstep=1)
            peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert len(find_blocks(tmp_path / "run", read_header(tmp_path / "run"))) > 4
    # A chunk, and the same again while it is written.
    assert peaks[-1] < 1.2 * peaks[0] + 20_000


def test_what_sensors_lost_is_forgotten_at_a_reset():
    sim = simulate(PENDULUM, sensors=stepper.SensorModel(default=stepper.Transfer(dropout=1.0)), steps=3)
    np.testing.assert_array_equal(sim.sensor_faults, [[0, 3]] * 3)
    sim.reset()
    assert not sim.sensor_faults.any()
    sim.step(nstep=0)
    assert not sim.sensor_faults.any()


@pytest.mark.parametrize("field", ["actuator_gainprm", "actuator_biasprm", "pair_friction", "geom_friction"])
def test_fields_of_elements_that_a_model_does_not_have_are_replayed(tmp_path, field):
    """A model without actuators and pairs has arrays of no elements for them."""
    model = stepper.load('<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>')
    sim = stepper.Stepper(model, 2)
    values = getattr(model, field)
    with sim.record(tmp_path / "run"):
        sim.randomize(**{field: np.broadcast_to(values, (2, *values.shape))})
        sim.step()
    assert stepper.recording.verify(tmp_path / "run")


def test_sensors_with_a_limit_per_environment_are_replayed(tmp_path):
    model = stepper.load(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody><sensor><jointpos joint="j"/></sensor></mujoco>'
    )
    sensors = stepper.SensorModel(default=stepper.Transfer(limits=(0.0, np.array([0.5, 2.0]))))
    sim = simulate(model, 2, sensors=sensors, qpos=[1.0])
    with sim.record(tmp_path / "run"):
        sim.step()
    assert sim.sensordata.ravel().tolist() == [0.5, 1.0]
    assert stepper.recording.verify(tmp_path / "run")
    assert sensors == stepper.SensorModel.from_dict(sensors.to_dict())


def shape_of(value):
    """Names and types in a header, without its numbers."""
    if isinstance(value, dict):
        return {name: shape_of(own) for name, own in value.items()}
    return type(value).__name__


def test_the_episode_of_the_benches_has_the_current_format(tmp_path):
    """Names, types and versions of everything in its files, which `cargo test -p stepper-benches` reads."""
    record(tmp_path / "new")
    old, new = read_header(EPISODE), read_header(tmp_path / "new")
    assert old["format"] == FORMAT
    assert shape_of(old) == shape_of(new), RENEW
    arrays = [joined(EPISODE), joined(tmp_path / "new")]
    kinds = [{name: (array.dtype.str, array.shape) for name, array in own.items()} for own in arrays]
    assert kinds[0] == kinds[1], RENEW
    np.testing.assert_array_equal(arrays[0]["kind"], arrays[1]["kind"])
    # Magic bytes and version of the model and of the state.
    assert (EPISODE / "model.stepper").read_bytes()[:12] == (tmp_path / "new/model.stepper").read_bytes()[:12], RENEW
    assert arrays[0]["0/state"][:13].tobytes() == arrays[1]["0/state"][:13].tobytes(), RENEW


def test_the_episode_of_the_benches_names_no_machine():
    head = json.loads((EPISODE / "run.json").read_text())
    assert head["model"]["source"] is None
    assert head["provenance"].keys() == {"versions"}
