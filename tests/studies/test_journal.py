"""The journal of a study: what was appended stays, several processes read, and what is damaged or belongs to others is refused."""

import contextlib
import math
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import stepper
from hypothesis import given, settings, strategies as st
from stepper.lab.study.journal import JOURNAL, Journal, JournalError, rows_of

ROWS = [{"key": str(k), "x": x} for k, x in enumerate([0.1, math.inf, math.nan, 1e-300])]
ANOTHER = """
import pathlib, signal, sys
from stepper.lab.study.journal import Journal, rows_of
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell starts the tests in the background
path = pathlib.Path(sys.argv[1])
"""
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda own: st.lists(own) | st.dictionaries(st.text(), own)
)


def another(program, path, **given):
    """Another process that runs a program with a journal's path."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(stepper.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen(
        [sys.executable, "-c", ANOTHER + program, str(path)], stdout=subprocess.PIPE, text=True, env=environment, **given
    )


@pytest.fixture
def path(tmp_path):
    """A journal of the study "push" with four rows."""
    with Journal(tmp_path / JOURNAL, "push") as journal:
        journal.append(ROWS)
    return tmp_path / JOURNAL


def test_a_journal_has_the_rows_of_an_earlier_run(path):
    with Journal(path, "push") as journal:
        assert repr(list(journal.rows.values())) == repr(ROWS)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.lists(values, max_size=4), max_size=4))
def test_all_rows_come_back_in_their_order(batches):
    """Rows of any JSON values, across openings, as they are in memory and as other processes read them."""
    keys = iter(range(100))
    rows = [[{"key": str(next(keys)), "value": value} for value in batch] for batch in batches]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / JOURNAL
        for batch in rows:
            with Journal(path, "any") as journal:
                journal.append(batch)
                assert repr(rows_of(path, "any")) == repr(list(journal.rows.values()))
        assert repr(rows_of(path)) == repr([row for batch in rows for row in batch])
        # Neither the writer nor a reader leaves a file of its own.
        assert {file.name for file in path.parent.glob("*")} <= {JOURNAL}


def test_processes_read_while_one_writes(path):
    """Each of them sees only whole batches, and in the end all of them."""
    read = """
while True:
    rows = rows_of(path, "push")
    assert len(rows) % 4 == 0, len(rows)
    if len(rows) == 400:
        break
print(len(rows))
"""
    readers = [another(read, path) for _ in range(3)]
    with Journal(path, "push") as journal:
        for k in range(1, 100):
            journal.append({"key": f"{k} {row['key']}", "x": row["x"]} for row in ROWS)
        assert [reader.communicate(timeout=60)[0] for reader in readers] == ["400\n"] * 3


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_process_that_ends_in_a_batch_loses_that_batch_alone(path, how):
    """The process is in the middle of a transaction, with a row of the batch written, when the signal comes."""
    write = """
import time
with Journal(path, "push") as journal:
    journal.append([{"key": "before"}])
    journal._file.create_function("wait", 0, lambda: print("half", flush=True) or time.sleep(60))
    journal._file.execute("CREATE TEMP TRIGGER late BEFORE INSERT ON rows WHEN NEW.key = 'second' BEGIN SELECT wait(); END")
    journal.append([{"key": "first"}, {"key": "second"}])
"""
    with another(write, path, stderr=subprocess.DEVNULL) as process:
        assert process.stdout.readline() == "half\n"
        assert repr(rows_of(path)) == repr([*ROWS, {"key": "before"}])
        process.send_signal(how)
    with Journal(path, "push") as journal:
        assert repr(list(journal.rows.values())) == repr([*ROWS, {"key": "before"}])
        journal.append([{"key": "first"}, {"key": "second"}])
    assert len(rows_of(path)) == 7


def test_a_process_that_ends_before_the_tables_exist_leaves_a_new_journal(tmp_path):
    sqlite3.connect(tmp_path / JOURNAL).close()
    (tmp_path / JOURNAL).touch()
    assert rows_of(tmp_path / JOURNAL) == rows_of(tmp_path / "none") == []
    with Journal(tmp_path / JOURNAL, "push") as journal:
        assert journal.rows == {}


def refused(path, match, study="push"):
    for read in (rows_of, Journal):
        with pytest.raises(JournalError, match=match) as error:
            read(path, study)
        assert str(path) in str(error.value)


def test_a_journal_of_another_study_is_refused(path):
    refused(path, "is the journal of study 'push', not of 'pull': choose another folder for the results, or delete it", "pull")


def test_a_journal_of_another_version_is_refused(path):
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.execute("PRAGMA user_version = 2")
    refused(path, "is a journal of version 2, must be version 1: delete it to run the study from the start, or use the version of stepper")


def test_another_file_is_refused(tmp_path):
    path = tmp_path / JOURNAL
    path.write_bytes(b'0badc0de {"key":"x"}\n' * 100)
    refused(path, "is no journal of a study, or is damaged .*: restore the file, or delete it")


def test_a_damaged_row_is_refused(path):
    whole = path.read_bytes()
    assert whole.count(b"1e-300") == 1
    path.write_bytes(whole.replace(b"1e-300", b"1e-301"))
    refused(path, "row 4 is damaged: restore the file, or delete it to run the study from the start")


def test_a_file_that_is_cut_is_refused(path):
    with Journal(path, "push") as journal:
        journal.append({"key": f"long {k}", "x": "x" * 1000} for k in range(20))
    whole = path.read_bytes()
    # SQLite takes a file of 0 bytes or 1 for a new one. 4096 is the size of a page.
    for length in [2, 50, 4095, *range(4096, len(whole), 4096), len(whole) - 1]:
        path.write_bytes(whole[:length])
        refused(path, "damaged")


def test_a_folder_without_permission_is_explained(tmp_path, monkeypatch):
    """The superuser may write everywhere, so a folder stands in the place of the file."""
    (tmp_path / JOURNAL).mkdir()
    with pytest.raises(JournalError, match=r"SQLite cannot use the file \(.*\): check its permissions and the space on the disk"):
        Journal(tmp_path / JOURNAL, "push")


def test_a_batch_that_does_not_fit_on_the_disk_is_explained(path):
    with Journal(path, "push") as journal:
        (pages,) = journal._file.execute("PRAGMA page_count").fetchone()
        journal._file.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(JournalError, match="database or disk is full"):
            journal.append([{"key": "fits"}, {"key": "large", "x": "x" * 100_000}])
        assert len(journal.rows) == len(ROWS)
    assert len(rows_of(path)) == len(ROWS)
