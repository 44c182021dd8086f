"""What a task of Ray does, without Ray: versions are compared before anything of the package is read."""

import pickle
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
import stepper
from stepper.cli import main
from stepper.lab.study.jobs import _guarded, _of_task, _refusal, each

ARM = (
    """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/><geom size=".05" pos=".2 0 0"/></body></worldbody></mujoco>"""
)


@pytest.fixture
def study():
    return stepper.lab.Study(model=ARM, seconds=0.1, threads=0, outcomes=stepper.lab.Outcome(name="angle", measure="joint hinge"))


def doubled(study, job):
    return study.threads, 2 * job


def test_a_job_is_run_where_versions_are_the_same(study):
    versions = study.identity["versions"]
    shared = pickle.dumps((_of_task(study), doubled))
    # threads=0 is all CPUs, and of a task it is the one that it has.
    assert _guarded()(versions, shared, pickle.dumps(4))[1:] == (versions, (1, 8))
    assert _of_task(replace(study, threads=3)).threads == 3
    assert study.threads == 0


@pytest.mark.parametrize("name", ["stepper", "numpy", "mujoco"])
def test_another_version_is_refused_before_anything_is_read(study, name):
    ours = study.identity["versions"] | {name: "0.0.1"}
    machine, theirs, made = _guarded()(ours, b"what only 0.0.1 can read", b"")
    assert made is None
    assert theirs == study.identity["versions"]
    told = _refusal(machine, theirs, ours)
    assert f"{machine} has {name} {theirs[name]} there and 0.0.1 here, so that" in told


def test_a_package_that_a_worker_lacks_is_named():
    told = _refusal("node7", {"stepper": "1.0", "mujoco": None}, {"stepper": "1.0", "mujoco": "4.0.0"})
    assert "node7 has mujoco (not installed) there and 4.0.0 here" in told


def test_without_ray_jobs_are_done_in_their_order(study):
    assert list(each(study, [3, 1], doubled)) == [(0, (0, 6)), (1, (0, 2))]


def test_a_refusal_ends_a_command_with_one_line(tmp_path, monkeypatch, capsys):
    """The whole way from a worker's versions to what a user reads, but for Ray."""

    class Ray:
        cloudpickle = SimpleNamespace(dumps=lambda _: b"", register_pickle_by_value=lambda _: None)
        is_initialized, put, cancel = (staticmethod(lambda *_: True), staticmethod(lambda value: value), staticmethod(lambda _: None))
        wait = staticmethod(lambda left, num_returns: (left[:num_returns], left[num_returns:]))
        get = staticmethod(lambda _: ("node7", {"stepper": "0.0.1", "numpy": None, "mujoco": None}, None))

        @staticmethod
        def remote(_):
            return SimpleNamespace(options=lambda **_: SimpleNamespace(remote=lambda *_: object()))

    monkeypatch.setattr("stepper.shared.ray_tasks.require", lambda *_: Ray)
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "study.toml").write_text('model = "arm.xml"\n[[outcomes]]\nname = "angle"\nmeasure = "joint hinge"\n')
    monkeypatch.setattr(sys, "argv", ["stepper", "sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path), "--ray"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert told[-1].startswith(f"stepper: a worker of Ray on node7 has stepper 0.0.1 there and {stepper.__version__} here, numpy")
    assert "Traceback" not in "".join(told)
