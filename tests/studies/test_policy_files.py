"""Policies of studies: files of `stepper.policies`, functions and objects with a memory."""

from dataclasses import replace

import numpy as np
import stepper
import stepper.policies
from servo_arm import ARM, angles
from stepper.lab.study.controllers import digest_of


def network(gain=-2.0):
    """tanh(gain (angle - 0.5) - rate / 2): a servo."""
    layer = (np.array([[gain], [-0.5]], np.float32), np.array([-0.5 * gain], np.float32))
    last = (np.ones((1, 1), np.float32), np.zeros(1, np.float32))
    one = np.ones(1)
    return stepper.policies.Policy(
        mean=np.zeros(2), std=np.ones(2), clip=10.0, layers=[layer, last], activation="tanh", low=-one, high=one, environment={}
    )


STUDY = """
model = "arm.xml"
policy = "servo.npz"
seconds = 0.2
episodes = 2
qpos_noise = 0.1
[[outcomes]]
name = "angle"
measure = "joint hinge"
"""


def test_a_policy_of_stepper_drives_a_study(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "reach.toml").write_text(STUDY)
    network().save(tmp_path / "servo.npz")
    study = stepper.lab.Study.from_file(tmp_path / "reach.toml")
    found = stepper.lab.sweep(study, tmp_path / "out").sweep
    same = replace(study, controller=stepper.lab.PolicyController(network()))
    other = stepper.lab.sweep(same, tmp_path / "other").sweep
    assert [row["outcomes"] for row in found.table.rows] == [row["outcomes"] for row in other.table.rows]
    # What the file holds is what rows follow from, not where it is.
    (tmp_path / "copy").mkdir()
    network().save(tmp_path / "copy/servo.npz")
    again = stepper.lab.PolicyController(stepper.policies.load(tmp_path / "copy/servo.npz"))
    changed = stepper.lab.PolicyController(network(-3.0))
    assert digest_of(again) == digest_of(study.controller) != digest_of(changed)


class Integrator:
    """Controls that grow from one to the next."""

    def begin(self, now):
        self._sum = np.zeros((now.num_envs, 1))

    def __call__(self, seen):
        self._sum += 0.1 * (0.5 - seen[:, :1])
        return self._sum


def test_a_memory_is_of_one_batch(tmp_path):
    policy = stepper.lab.PolicyController(Integrator())
    assert angles(policy, tmp_path, 1) == angles(policy, tmp_path, 4)


def test_a_class_of_a_file_is_told_of_starts(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "memory.py").write_text("""
class Count:
    def begin(self, now):
        self._count = 0

    def __call__(self, seen):
        self._count += 1
        return 0.01 * self._count + 0.0 * seen[:, :1]
""")
    (tmp_path / "reach.toml").write_text(STUDY.replace("servo.npz", "memory.py:Count"))
    study = stepper.lab.Study.from_file(tmp_path / "reach.toml")
    one, all_ = (stepper.lab.sweep(replace(study, batch=n), tmp_path / f"{n}").sweep.table.rows for n in (1, 2))
    assert [row["outcomes"] for row in one] == [row["outcomes"] for row in all_]
