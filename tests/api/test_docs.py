"""Documentation of everything public: `help`, the stub, shapes and units of arrays, messages of Rust, and submodules."""

import ast
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from array_docs import arrays_of
from stub_docs import STUB, documented, rewritten, spoken

ROOT = Path(__file__).parents[2] / "python/stepper"
EXCEPTIONS: frozenset[str] = frozenset()
"""Places of arrays without a shape or a unit. The list may only become shorter."""
HINGE = '<mujoco{option}><worldbody><body><joint name="j" type="hinge"/><geom size=".1"/></body></worldbody></mujoco>'


def test_the_stub_has_the_docstrings_of_the_binary():
    assert rewritten(STUB.read_text()) == STUB.read_text(), "run: python tests/helpers/stub_docs.py"


@pytest.mark.parametrize("owner", [stepper.Stepper, stepper.Model, stepper.State])
def test_help_says_something_of_every_attribute(owner):
    silent = [name for name in dir(owner) if not name.startswith("_") and len(spoken(owner, name)) < 5]
    assert silent == []
    assert len(inspect.getdoc(owner)) > 50


def test_every_attribute_is_in_the_stub():
    named = {(owner, name) for _, owner, name, _, _ in documented(ast.parse(STUB.read_text()))}
    for owner in (stepper.Stepper, stepper.Model, stepper.State):
        assert [name for name in dir(owner) if not name.startswith("_") and (owner, name) not in named] == []


@pytest.mark.parametrize("name", sorted(stepper.__all__))
def test_every_public_name_is_documented(name):
    thing = getattr(stepper, name)
    if callable(thing) or inspect.ismodule(thing):
        assert len(inspect.getdoc(thing) or "") > 20


def test_fields_of_a_model_say_unit_and_shape():
    assert stepper.Model.body_mass.__doc__ == "Mass, kg: (nbody,)."
    assert stepper.Model.geom_friction.__doc__ == "Sliding (1), torsional (m), rolling (m) friction: (ngeom, 3)."


def test_docstrings_name_the_shape_and_the_unit_of_each_array():
    found = list(arrays_of(sorted(ROOT.rglob("*.py")), ROOT))
    assert len(found) > 300
    assert {array.place: array.lacks for array in found if array.lacks and array.place not in EXCEPTIONS} == {}


@pytest.mark.parametrize(("text", "lacks"), [
    ('"""Sum.\n\n    Args:\n        a: Positions, (n, 3), m.\n    """', [[]]),
    ('"""Sum.\n\n    Args:\n        a: Positions, (n, 3).\n    """', [["unit"]]),
    ('"""Sum.\n\n    Args:\n        a: Positions, m.\n    """', [["shape"]]),
    ('"""Sum.\n\n    Args:\n        b: Positions, (n, 3), m.\n    """', [["shape", "unit"]]),
    ('"""Sum of the masses, (n,), kg."""', [[]]),
    ('"""Sum."""', [["shape", "unit"]]),
])  # fmt: skip
def test_a_planted_docstring_is_found(tmp_path, text, lacks):
    file = tmp_path / "planted.py"
    file.write_text(f"def f(a: Array) -> float:\n    {text}\n")
    assert [array.lacks for array in arrays_of([file], tmp_path)] == lacks


def test_an_override_inherits_the_description(tmp_path):
    file = tmp_path / "planted.py"
    base = 'class A:\n    def f(self, a: Array):\n        """Mass, (n,), kg."""\n'
    file.write_text(base + 'class B(A):\n    def f(self, a: Array):\n        """Mass."""\n')
    assert [array.place for array in arrays_of([file], tmp_path)] == ["planted.py:A:f(a)"]


# Messages of the core and of the crates below it name the calls of Rust, and the bindings say them with Python's.

TOP = Path(__file__).parents[2]
SOURCES = sorted(path for crate in ("geometry", "model", "core", "derivative") for path in (TOP / "crates" / crate / "src").rglob("*.rs"))
PYTHON = re.compile(r"Stepper\(|strict=False|=\.\.\.|contact=\\?\"|method='|\bget_state|Options\.|reset\(qpos")


def code(source: str) -> list[str]:
    return [line for line in source.split("#[cfg(test)]", maxsplit=1)[0].splitlines() if not line.lstrip().startswith("//")]


def test_the_core_does_not_speak_python():
    found = [f"{path.relative_to(TOP)}: {line.strip()}" for path in SOURCES for line in code(path.read_text()) if PYTHON.search(line)]
    assert not found, "\n".join(found)


def test_every_phrase_that_is_translated_is_said():
    phrases = re.findall(r'^    \("((?:[^"\\]|\\.)*)",', (TOP / "crates/python/src/phrases.rs").read_text(), re.MULTILINE)
    assert len(phrases) > 10
    sources = [re.sub(r"\\\n\s*", "", path.read_text()) for path in SOURCES]
    assert [phrase for phrase in phrases if not any(phrase in source for source in sources)] == []


@pytest.mark.parametrize(("call", "message"), [
    (lambda m: stepper.Stepper(m, options=stepper.Options(integrator="implicitfast")), 'rk4 with contact="hard"'),
    (lambda m: stepper.Stepper(m, 1).randomize(timestep=np.ones(1)), r"make a stepper.Stepper of model\.replace\(timestep=\.\.\.\)"),
    (
        lambda m: stepper.Stepper(m, 1).randomize(jnt_stiffness=np.ones((1, 1))),
        r"with model\.replace\(jnt_stiffness=\.\.\.\), and create the Stepper of that model",
    ),
    (
        lambda m: stepper.Stepper(m, options=stepper.Options(integrator="rk4")).linearize(method="implicit"),
        "for method='implicit'; method='fd' takes all",
    ),
])  # fmt: skip
def test_messages_have_pythons_names(call, message):
    with pytest.raises(ValueError, match=message):
        call(stepper.load(HINGE.format(option="")))


def test_reports_have_pythons_names():
    text = HINGE.format(option="").replace("<worldbody>", '<option integrator="RK4"/><worldbody>', 1)
    with pytest.warns(stepper.ModelWarning, match=r"Options\.from_model\(model\) uses the source's"):
        model = stepper.load(text)
    assert "Options.from_model(model)" in model.explain()
    assert "::" not in model.explain()


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
