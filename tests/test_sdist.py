"""The source distribution has the crates and the package, which is what a build needs."""

import os
import shutil
import subprocess
import sysconfig
import tarfile
import tomllib

import pytest
from wheel import PACKAGE, ROOT, sources

VERSION = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
TOP = {"Cargo.lock", "Cargo.toml", "LICENSE-APACHE", "LICENSE-MIT", "NOTICES", "PKG-INFO", "README.md", "pyproject.toml"}

MATURIN = shutil.which("maturin", path=os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]]))

pytestmark = pytest.mark.skipif(MATURIN is None or shutil.which("cargo") is None, reason="maturin makes it, with cargo")


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> dict[str, bytes]:
    """Files of a source distribution without its folder."""
    folder = tmp_path_factory.mktemp("sdist")
    subprocess.run([MATURIN, "sdist", "--out", folder], cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(folder / f"stepper_sim-{VERSION}.tar.gz") as tar:
        members = [member for member in tar if member.isfile()]
        return {member.name.partition("/")[2]: tar.extractfile(member).read() for member in members}


def test_it_has_the_crates_and_the_package_and_nothing_else(archive):
    crates = {
        str(file.relative_to(ROOT)): file.read_bytes()
        for crate in (ROOT / "crates").iterdir()
        for file in crate.rglob("*")
        if file.is_file()
    }
    package = {f"python/stepper/{file.relative_to(PACKAGE)}": file.read_bytes() for file in sources()}
    assert archive.keys() == TOP | crates.keys() | package.keys()
    # Manifests lose what is of the repository alone: benches.
    changed = {name for name, data in (crates | package).items() if archive[name] != data}
    assert changed <= {"crates/python/Cargo.toml", "crates/core/Cargo.toml"}


def test_its_workspace_has_no_member_that_it_lacks(archive):
    workspace = tomllib.loads(archive["Cargo.toml"].decode())["workspace"]
    assert all(f"{member}/Cargo.toml" in archive for member in workspace["members"])
    assert tomllib.loads(archive["Cargo.toml"].decode())["profile"]["release"]["strip"] == "symbols"


def test_its_metadata_is_that_of_the_project(archive):
    told = archive["PKG-INFO"].decode()
    assert f"Name: stepper-sim\nVersion: {VERSION}\n" in told
    assert "License-Expression: MIT OR Apache-2.0" in told
