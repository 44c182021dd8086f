"""A study over Ray has the rows of one without, for a file of the study's own, and goes on where it was stopped."""

from dataclasses import replace

import numpy as np
import pytest
import ray
import stepper
from stepper.lab.study.journal import rows_of
from stepper.lab.study.results import JOURNAL
from typer.testing import CliRunner

DRIVE = """
import numpy as np

GAIN = 0.3

class Drive:
    def begin(self, now):
        self._count = 0

    def __call__(self, now):
        self._count += 1
        return np.full((now.num_envs, 1), GAIN * np.sin(0.7 * self._count))

def angle(now):
    return now.read("qpos", "hinge")[:, 0]
"""
STUDY = """
model = "arm.xml"
controller = "drive.py:Drive"
seconds = 0.2
episodes = 3
qpos_noise = 0.1
[[outcomes]]
name = "angle"
measure = "drive.py:angle"
success = ">= 0.45"
[parameters.step]
selector = "options.timestep"
values = [0.001, 0.002, 0.004]
[parameters.damping]
selector = "dof_damping"
low = 0.5
high = 2.0
"""
ARM = """<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/>
  <geom size=".05" pos=".2 0 0"/></body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


@pytest.fixture
def study(tmp_path):
    for name, text in (("arm.xml", ARM), ("drive.py", DRIVE), ("study.toml", STUDY)):
        (tmp_path / name).write_text(text)
    return stepper.lab.Study.from_file(tmp_path / "study.toml")


def test_the_rows_are_those_of_one_process(study, tmp_path):
    here = stepper.lab.sweep(study, tmp_path / "here")
    there = stepper.lab.sweep(replace(study, ray=True, batch=4), tmp_path / "there")
    assert there.sweep.table.rows == here.sweep.table.rows
    assert there.sweep.cliffs == here.sweep.cliffs
    # Nothing is left to run.
    before = rows_of(tmp_path / "there/study" / JOURNAL)
    assert stepper.lab.sweep(study, tmp_path / "there").sweep.table.rows == here.sweep.table.rows
    assert rows_of(tmp_path / "there/study" / JOURNAL) == before


def test_threads_of_all_cpus_are_one_of_a_task(study, tmp_path):
    """Tasks take all CPUs, so that each of them has one."""
    # A function of this module is not where workers would find it; one without a name goes along.
    threads = stepper.lab.Outcome(name="threads", measure=lambda now: np.full(now.num_envs, float(now.sim.threads)))
    here = stepper.lab.sweep(study, tmp_path / "here", cliffs=False)
    all_of_them = replace(study, ray=True, threads=0, outcomes=[*study.all_outcomes, threads])
    there = stepper.lab.sweep(all_of_them, tmp_path / "there", cliffs=False)
    assert {row["outcomes"].pop("threads") for row in there.sweep.table.rows} == {1.0}
    assert [row["outcomes"] for row in there.sweep.table.rows] == [row["outcomes"] for row in here.sweep.table.rows]


def test_what_fails_in_a_worker_is_raised_here(study, tmp_path):
    broken = replace(study, ray=True, outcomes=stepper.lab.Outcome(name="a", measure=lambda now: now.read("qpos", "elbow")[:, 0]))
    with pytest.raises(KeyError, match="elbow"):
        stepper.lab.sweep(broken, tmp_path)


def test_the_command(study, tmp_path, monkeypatch):
    from stepper.cli.app import application

    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(application(), ["sweep", "study.toml", "--no-cliffs", "--ray"])
    assert told.exit_code == 0, told.output
    assert "wrote out/study/sweep.html" in told.output
