"""`stepper doctor` names versions, CPU levels and missing packages, and compares the bits of a short trajectory at every CPU level."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import stepper
from stepper.doctor import diagnosis, self_test

ROOT = Path(__file__).parents[2]


def test_the_command_finds_this_installation_in_order():
    done = subprocess.run([sys.executable, "-m", "stepper.cli", "doctor"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(rf"stepper +{re.escape(stepper.__version__)}\n", done.stdout)
    assert re.search(rf"CPU levels +{', '.join(stepper.doctor.cpu_levels())}; in use: ", done.stdout)
    for level in stepper.doctor.cpu_levels():
        assert re.search(rf"{level} +trajectory as expected\n", done.stdout)


def test_other_bits_fail_with_both_digests(monkeypatch):
    monkeypatch.setattr(diagnosis, "expected_digest", lambda: "0" * 64)
    found = stepper.doctor.diagnose()
    assert not found
    assert list(found.self_test) == stepper.doctor.cpu_levels()
    assert "other bits: " in str(found)
    assert "expected 0000000000000000" in str(found)
    assert "STEPPER_CPU_LEVEL=baseline" in str(found)


def test_a_self_test_that_fails_is_reported_with_its_last_line():
    with pytest.raises(RuntimeError, match=r"self-test failed at CPU level avx9: .*avx9"):
        self_test.digest_at("avx9")


def test_the_digest_depends_on_the_trajectory(monkeypatch):
    monkeypatch.setattr(self_test, "_STEPS", 3)
    assert self_test.trajectory_digest() != self_test.expected_digest()


@pytest.mark.parametrize(("whole", "good"), [("4.0.1", True), ("3.17.0", False), (None, True)])
def test_two_versions_of_mujoco_in_one_folder_are_named(monkeypatch, whole, good):
    versions = {"mujoco": whole, "mujoco-core": "4.0.1"}
    monkeypatch.setattr(diagnosis, "package_version", versions.get)
    found = stepper.doctor.diagnose(self_test=False)
    assert bool(found) == good
    assert ("pip uninstall mujoco mujoco-core" in str(found)) != good


def test_an_unknown_cpu_level_is_named_with_those_that_exist(monkeypatch):
    monkeypatch.setenv("STEPPER_CPU_LEVEL", "avx9")
    found = stepper.doctor.diagnose(self_test=False)
    assert not found
    levels = ", ".join(found.cpu_levels)
    assert f"STEPPER_CPU_LEVEL=avx9 names no level of this machine and build; unset it, or use one of {levels}" in str(found)


def test_a_missing_package_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr(diagnosis, "package_version", lambda name: None if name == "viser" else "1.2.3")
    found = stepper.doctor.diagnose(self_test=False)
    assert found
    assert re.search(r'viewer +missing viser: pip install "stepper-sim\[viewer\]"\n', str(found))
    assert re.search(r"identify +scipy 1\.2\.3", str(found))


def test_the_extras_are_those_of_the_package():
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {extra: tuple(sorted(re.match(r"[\w-]+", line)[0] for line in lines)) for extra, lines in asked.items()}
    assert {extra: tuple(sorted(packages)) for extra, packages in diagnosis.PACKAGES.items()} == names
