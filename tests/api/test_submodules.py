"""Submodules are there after `import stepper`, and the command line is one of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import stepper

FOLDERS = list(stepper._SUBMODULES)
ADAPTERS = sorted(file.stem for file in Path(stepper.__file__).parent.glob("adapters/*.py") if file.stem != "__init__")


def said(*command):
    """Output of a command of a new interpreter."""
    return subprocess.run([sys.executable, "-W", "ignore", *command], capture_output=True, text=True, check=True).stdout


def test_every_folder_is_an_attribute():
    names = ", ".join(f"stepper.{name}.__name__" for name in FOLDERS)
    found = said("-c", f"import stepper; print({names}); assert not set({FOLDERS}) - set(dir(stepper))")
    assert found.split() == [f"stepper.{name}" for name in FOLDERS]


def test_importing_stepper_imports_none_that_is_slow():
    """The binary and what belongs to its classes. `python tests/helpers/wheel.py` measures the time."""
    found = said("-c", "import stepper, sys; print(*sorted(name for name in sys.modules if name.startswith('stepper')))")
    assert found.split() == ["stepper", "stepper._hints", "stepper._options", "stepper._status", "stepper._stepper"]


@pytest.mark.parametrize("name", ["ActuatorModel", "ModelWarning", "SensorModel", "load"])
def test_a_name_of_the_engine_can_be_imported_first(name):
    """One name of each module that is imported at its first use."""
    assert said("-c", f"from stepper import {name}; import stepper; assert stepper.{name} is {name}") == ""


def test_every_adapter_is_an_attribute():
    assert set(ADAPTERS) <= set(dir(stepper.adapters))
    assert stepper.adapters.native.make_native
    with pytest.raises(AttributeError, match=r"'stepper\.adapters' has no attribute 'acme'$"):
        _ = stepper.adapters.acme


@pytest.mark.parametrize("module", ["stepper", "stepper.cli"])
def test_a_module_runs_the_command_line(module):
    assert "demo" in said("-m", module, "--help")


def test_a_shell_completes_commands():
    """`stepper --install-completion` adds to the shell's settings a call like this one."""
    asked = {"_STEPPER_COMPLETE": "complete_bash", "COMP_WORDS": "stepper do", "COMP_CWORD": "1"}
    program = "import sys; sys.argv[0] = 'stepper'; from stepper.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", program], env=os.environ | asked, capture_output=True, text=True, check=True)
    assert done.stdout == "doctor\n"
