"""Recordings whose process was killed or whose disk was full are replayed up to their last second; no file makes a replay endless."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, strategies as st
from recordings import PENDULUM, disk_of, edit_file, edit_header
from stepper.recording import RecordingError, RecordingWarning, recorder
from stepper.recording.format import KINDS, ROWS, find_blocks, read_header
from stepper.shared.files import LOCK

RECORD = """
import sys
import numpy as np, stepper
sim = stepper.Stepper(stepper.load(sys.argv[1]), 2)
recording = sim.record(sys.argv[2], chunk=1)
print(recording.rows, flush=True)
for k in range(10**9):
    sim.step(np.full((2, 1), np.sin(k)), nstep=1 + k % 3)
    print(recording.rows, flush=True)
"""
MODEL = stepper.load(PENDULUM)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of 30 calls that was not closed, with a block for each row. Its run.json is that of an earlier time, with four rows."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    sim = stepper.Stepper(MODEL, 2)
    recording = sim.record(folder, chunk=1)
    for k in range(30):
        if k == 3:
            kept = (folder / "run.json").read_bytes()
        sim.step(np.full((2, 1), np.sin(k)))
    sim.recorder = None
    (folder / "run.json").write_bytes(kept)
    assert recording.rows == 31
    return folder


@pytest.fixture
def unclosed(whole, tmp_path):
    """A copy of the recording that was not closed."""
    shutil.copytree(whole, tmp_path / "run")
    return tmp_path / "run"


def test_a_recording_whose_process_is_killed_keeps_the_rows_that_were_written(tmp_path):
    """Without a chance to close anything: every row that the process has counted is there, and perhaps the next."""
    MODEL.save(tmp_path / "model.stepper")
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    command = [sys.executable, "-c", RECORD, str(tmp_path / "model.stepper"), str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": paths}) as process:
        lines = [int(process.stdout.readline()) for _ in range(40)]
        raises(BlockingIOError, "another run writes to this folder", lambda: stepper.Stepper(MODEL).record(tmp_path / "run"))
        process.send_signal(signal.SIGKILL)
        lines += [int(line) for line in process.stdout if line.endswith("\n")]
    assert process.returncode == -signal.SIGKILL
    result = stepper.recording.verify(tmp_path / "run")
    assert result
    assert not result.complete
    assert result.rows in (lines[-1], lines[-1] + 1)
    assert "not closed" in str(result)
    with pytest.warns(RecordingWarning, match=rf"run was not closed: it ends after {result.rows} rows"):
        assert sum(len(segment.ctrl) for segment in stepper.recording.segments(tmp_path / "run")) == result.steps
    raises(FileExistsError, "is not empty", lambda: stepper.Stepper(MODEL).record(tmp_path / "run"))


def test_rows_are_written_within_a_second_and_in_blocks(tmp_path, monkeypatch):
    """By a clock of which each call of `step` takes 0.3 s: four rows reach the age of a second together."""
    now = [0.0]
    monkeypatch.setattr(recorder.time, "monotonic", lambda: now[0])
    sim = stepper.Stepper(MODEL)
    with sim.record(tmp_path / "run") as recording:
        for k in range(1, 21):
            now[0] += 0.3
            sim.step()
            # At any time, the folder has all rows but those of the last second.
            shutil.copytree(tmp_path / "run", tmp_path / f"copy{k}", ignore=shutil.ignore_patterns(LOCK))
            result = stepper.recording.verify(tmp_path / f"copy{k}")
            assert recording.rows - result.rows <= 1.0 / 0.3
            assert not result.complete
    assert len(find_blocks(tmp_path / "run", read_header(tmp_path / "run"))) == 1 + 20 // 4
    assert stepper.recording.verify(tmp_path / "run").complete


@given(data=st.data())
def test_a_recording_that_is_cut_anywhere_is_replayed_up_to_there(tmp_path_factory, whole, data):
    folder = tmp_path_factory.mktemp("cut") / "run"
    shutil.copytree(whole, folder)
    rows = (folder / ROWS).read_bytes()
    blocks, counted = find_blocks(folder, read_header(folder)), read_header(folder)["size"]
    length = data.draw(st.integers(counted, len(rows)))
    (folder / ROWS).write_bytes(rows[:length] + data.draw(st.sampled_from([b"", b"\0", bytes(500), b"\xff" * 500])))
    result = stepper.recording.verify(folder)
    assert result.rows == sum(block.end <= length for block in blocks)
    assert (bool(result), result.complete) == (True, False)


def test_a_recording_that_lost_what_its_header_counts_is_refused(unclosed):
    """Rows were taken away after the process ended, or others were put in their place."""
    whole = (unclosed / ROWS).read_bytes()
    counted = read_header(unclosed)["size"]
    for content in (whole[: counted - 1], b"", bytes(len(whole)), whole[:counted].replace(b"\0\0", b"\0\1") + whole[counted:]):
        (unclosed / ROWS).write_bytes(content)
        raises(RecordingError, ROWS, stepper.recording.verify, unclosed)


def test_a_full_disk_ends_a_recording_that_is_read_up_to_there(tmp_path):
    sim = stepper.Stepper(MODEL, 2)
    with sim.record(tmp_path / "run", chunk=1) as recording:
        with pytest.raises(OSError, match=r"rows\.bin") as error, disk_of(30_000):
            for k in range(1000):
                sim.step(np.full((2, 1), np.sin(k)))
        assert error.value.errno == errno.EFBIG
        rows = recording.rows - 1
        assert f"the recording ends here, after {rows} rows" in str(error.value)
        assert "give another path" in str(error.value)
        # The stepper goes on without recording, and closing the recording is no second error.
        assert sim.recorder is None
        sim.step()
    result = stepper.recording.verify(tmp_path / "run")
    assert (bool(result), result.rows, result.complete) == (True, rows, False)
    assert rows > 5
    assert (tmp_path / "run" / ROWS).stat().st_size <= 30_000
    with sim.record(tmp_path / "other"):
        sim.step()
    assert stepper.recording.verify(tmp_path / "other").complete


def test_a_full_disk_at_the_end_is_named(tmp_path):
    """The rows that wait in memory cannot be written by `close`."""
    sim = stepper.Stepper(MODEL, 2)
    recording = sim.record(tmp_path / "run")
    for _ in range(300):
        sim.step()
    with disk_of(20_000), pytest.raises(OSError, match=r"File too large; .*the recording ends here, after \d+ rows: .*rows\.bin"):
        recording.close()
    assert sim.recorder is None
    assert stepper.recording.verify(tmp_path / "run").complete is False


def test_a_disk_that_is_full_from_the_start_is_named(tmp_path):
    sim = stepper.Stepper(MODEL)
    with disk_of(100), pytest.raises((OSError, stepper.ModelError), match="run/"):
        sim.record(tmp_path / "run")
    assert sim.recorder is None


# Counts


@pytest.fixture
def run(tmp_path):
    """A recording of a call of three steps of two environments."""
    sim = stepper.Stepper(MODEL, 2)
    with sim.record(tmp_path / "run"):
        sim.step(nstep=3)
    return tmp_path / "run"


@pytest.mark.parametrize(("row", "said"), [
    *(({"nstep": [n]}, r"rows\.bin, row 1: nstep is \d+, but the recorded time advances by 0\.006 s, at a time step of")
      for n in (10**12, 2**62, 10**6, 1e300, 1e12)),
    ({"nstep": [10**12], "time": [[np.nan, np.nan]]}, "nstep is"),
])  # fmt: skip
def test_a_row_cannot_make_a_replay_endless(run, row, said):
    """Behind checksums that are right: the recorded time says how many steps there were."""
    edit_file(run, lambda arrays: arrays.update({name: np.array(value) for name, value in row.items()}))
    raises(RecordingError, said, stepper.recording.verify, run)


def test_rejected_steps_are_replayed_though_they_take_no_time(tmp_path):
    """In one environment of two, in both, and after a change of the time."""
    sim = stepper.Stepper(MODEL, 2)
    with sim.record(tmp_path / "run"):
        sim.step([[np.nan], [0.0]], nstep=50)
        sim.step([[np.nan], [np.nan]], nstep=50)
        sim.set_state(time=[1e6, 5.0])
        sim.step(nstep=1000)
        sim.reset()
        sim.step(nstep=1000)
    assert stepper.recording.verify(tmp_path / "run")


@pytest.mark.parametrize(("change", "said"), [
    *(({"num_envs": n}, r"num_envs is \d+, but the state in the first row has \d+ bytes") for n in (10**5, 10**9, 10**15, 2**64)),
    *((change, "run") for change in ({"num_envs": 3}, {"rows": 10**12}, {"steps": 10**12}, {"size": 10**12}, {"rows": -1}, {"rows": True})),
])  # fmt: skip
def test_counts_in_a_header_are_those_of_the_rows(run, change, said):
    edit_header(run, lambda head: head.update(change))
    raises(RecordingError, said, stepper.recording.verify, run)


def test_threads_in_a_header_are_no_more_than_the_machine_has(run):
    edit_header(run, lambda head: head.update(threads=10**9))
    assert stepper.recording.verify(run)


def test_the_definition_that_other_languages_read_is_that_of_the_format():
    shared = json.loads((Path(recorder.__file__).parent / "format.json").read_text())
    assert shared["rows"] == ROWS
    assert tuple(shared["kinds"]) == KINDS
