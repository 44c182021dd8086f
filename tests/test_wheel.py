"""The wheel works where there is no compiler and no MuJoCo, and says what it is and what is in it."""

import hashlib
import json
import re
import tomllib
import zipfile
from email.message import Message
from email.parser import Parser

import numpy as np
import pytest
import stepper
from models import stepper_model
from notices import linked
from wheel import PACKAGE, ROOT, built, call, install, install_beside_tests, run, sources

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
STEPS = 200

STEP = """
import hashlib, importlib.util, json, shutil, sys
from importlib import metadata
import stepper

model = stepper.load(sys.argv[1])
sim = stepper.Stepper(model, num_envs=24)
sim.step([0.25] * model.nu, nstep=int(sys.argv[2]))
try:
    stepper.load("<mujoco/>")
    said = ""
except ImportError as error:
    said = str(error)
print(json.dumps({
    "bits": hashlib.sha256(sim.qpos.tobytes()).hexdigest(),
    "status": int(sim.status.max()),
    "version": [stepper.__version__, metadata.version("stepper-sim")],
    "inside": stepper.__file__.startswith(sys.prefix),
    "absent": [importlib.util.find_spec("mujoco"), shutil.which("cargo"), shutil.which("rustc")],
    "said": said,
}))
"""
API = [f"tests/api/test_{name}.py" for name in ("stepper", "state", "record", "doctor")]


@pytest.fixture(scope="module")
def wheel():
    found = built()
    if found is None:
        pytest.skip("there is no wheel of this state of the sources: make wheel")
    return found


@pytest.fixture(scope="module")
def contents(wheel) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def metadata(contents) -> Message:
    return Parser().parsestr(contents[f"stepper_sim-{VERSION}.dist-info/METADATA"].decode())


def test_it_steps_a_saved_model_where_there_is_only_numpy(wheel, tmp_path):
    """The same bits as here."""
    model = stepper_model("gymnasium/humanoid")
    model.save(tmp_path / "humanoid.stepper")
    there = run(install(wheel, tmp_path / "bare"), STEP, str(tmp_path / "humanoid.stepper"), str(STEPS))
    sim = stepper.Stepper(model, num_envs=24)
    sim.step(np.full(model.nu, 0.25), nstep=STEPS)
    assert there["bits"] == hashlib.sha256(sim.qpos.tobytes()).hexdigest()
    assert there["status"] == int(sim.status.max())
    assert there["version"] == [VERSION, VERSION]
    assert there["inside"]
    assert there["absent"] == [None, None, None]
    assert 'pip install "stepper-sim[mjcf]"' in there["said"]


@pytest.fixture(scope="module")
def equipped(wheel, tmp_path_factory):
    """An environment of the wheel, beside the packages that the tests have."""
    return install_beside_tests(wheel, tmp_path_factory.mktemp("equipped"))


def test_the_readmes_code_and_the_tests_of_the_interface_run_with_it(equipped, tmp_path):
    program = "import stepper, sys; assert stepper.__file__.startswith(sys.prefix); import pytest; sys.exit(pytest.main(sys.argv[1:]))"
    options = ["-n", "0", "-p", "no:cacheprovider", f"--rootdir={ROOT}", f"--config-file={ROOT / 'pyproject.toml'}"]
    tests = [*API, "tests/test_documents.py::test_code_blocks_run[README.md]"]
    said = call(equipped, "-P", "-c", program, *options, *(str(ROOT / test) for test in tests), cwd=tmp_path)
    assert int(re.search(r"(\d+) passed", said)[1]) > 200


def test_its_demo_runs(equipped, tmp_path):
    call(equipped, str(equipped.with_name("stepper")), "demo", "--num-envs", "8", "--steps", "5", "--rest", "5", cwd=tmp_path)
    assert json.loads((tmp_path / "out/demo.json").read_text())


def test_its_binary_needs_no_newer_glibc_than_its_tag_says(wheel, contents):
    (tag,) = re.findall(r"manylinux_2_(\d+)_x86_64", wheel.name)[:1]
    (binary,) = (data for name, data in contents.items() if name.endswith(".so"))
    assert max({int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)", binary)}) <= int(tag)


def test_it_has_a_list_of_the_linked_libraries_for_scanners(contents):
    """CycloneDX, the libraries of NOTICES, under the folder of PEP 770."""
    (name,) = (name for name in contents if name.startswith(f"stepper_sim-{VERSION}.dist-info/sboms/"))
    told = json.loads(contents[name])
    assert told["bomFormat"] == "CycloneDX"
    listed = {(part["name"], part["version"]) for part in told["components"]}
    assert {(package["name"], package["version"]) for package in linked()} <= listed


def test_its_metadata_has_the_name_the_version_and_what_it_needs(metadata):
    assert (metadata["Name"], metadata["Version"]) == ("stepper-sim", VERSION)
    assert metadata["License-Expression"] == "MIT OR Apache-2.0"
    required = [line for line in metadata.get_all("Requires-Dist") if "extra ==" not in line]
    assert required == PROJECT["dependencies"] == ["numpy>=2.0"]
    assert {line.partition(", ")[0] for line in metadata.get_all("Project-URL")} == set(PROJECT["urls"])
    assert set(metadata.get_all("Provides-Extra")) == set(PROJECT["optional-dependencies"])


def test_it_carries_its_licences_and_those_of_what_is_linked(metadata, contents):
    assert set(metadata.get_all("License-File")) == set(PROJECT["license-files"]) == {"LICENSE-MIT", "LICENSE-APACHE", "NOTICES"}
    for name in PROJECT["license-files"]:
        assert contents[f"stepper_sim-{VERSION}.dist-info/licenses/{name}"] == (ROOT / name).read_bytes()


def test_it_has_every_file_of_the_package_with_its_types_and_nothing_else(contents):
    expected = {f"stepper/{file.relative_to(PACKAGE)}": file.read_bytes() for file in sources()}
    assert {"stepper/py.typed", "stepper/_stepper.pyi"} <= expected.keys()
    found = {name: data for name, data in contents.items() if name.startswith("stepper/") and not name.endswith(".so")}
    assert found == expected
    assert ({name.split("/")[0] for name in contents} - {"stepper"}) <= {f"stepper_sim-{VERSION}.dist-info", "stepper_sim.libs"}


def test_its_binary_is_stripped(contents):
    """Names of sections that only a debugger reads are absent from the table of names at its end."""
    (binary,) = (data for name, data in contents.items() if name.endswith(".so"))
    assert binary.startswith(b"\x7fELF")
    assert b".text" in binary[-4096:]
    assert b".debug_info" not in binary[-4096:]
    assert b".symtab" not in binary[-4096:]
