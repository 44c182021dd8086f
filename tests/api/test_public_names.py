"""The public interface is the one that public_names.txt lists: a change of a name or a signature is a line of the diff.

After a change that is meant:

    PYTHONPATH=python:tests .venv/bin/python tests/api/test_public_names.py
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from enum import Flag
from pathlib import Path
from typing import Any

import pytest
import stepper
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from stepper import _stepper
from stepper._other_names import ROOT_NAMES

LISTED = Path(__file__).with_name("public_names.txt")
RENEW = "PYTHONPATH=python:tests .venv/bin/python tests/api/test_public_names.py"
MODULES = ("actuators", "adapters", "derivatives", "doctor", "envs", "lab", "policies", "recording", "sensors", "sysid", "viewer")
ROOT = {
    *("load", "Model", "Stepper", "Options", "Status", "State", "ModelError", "ModelWarning", "SensorModel", "Transfer"),
    *("ActuatorModel", "Drive", "Recorder", "replay", "__version__"),
    *("add", "log_uniform", "scale", "uniform"),
}
"""Names of the engine, in `stepper` itself."""


def listing() -> list[str]:
    """All public names with signatures, sorted: of `stepper`, its submodules, and classes of the binary."""
    found = [line for name in ROOT for line in lines_of(f"stepper.{name}", getattr(stepper, name))]
    for module in MODULES:
        names = getattr(importlib.import_module(f"stepper.{module}"), "__all__", ())
        found += [f"stepper.{module}"]
        found += [line for name in names for line in lines_of(f"stepper.{module}.{name}", getattr(getattr(stepper, module), name))]
    elements = set(_stepper.__all__) - ROOT - {"selected"}
    found += [line for name in elements for line in lines_of(f"stepper._stepper.{name}", getattr(_stepper, name))]
    return sorted(set(found))


def lines_of(name: str, thing: Any) -> Iterator[str]:
    """Lines of a name: with its signature, and of a class those of its public attributes."""
    if inspect.isclass(thing):
        yield f"{name}{signature_of(thing)}"
        if issubclass(thing, Flag):
            yield from (f"{name}.{flag.name} = {flag.value}" for flag in thing)
            return
        fields = getattr(thing, "__annotations__", {})
        for attribute in sorted({*vars(thing), *fields}):
            if not attribute.startswith("_"):
                yield from member(f"{name}.{attribute}", inspect.getattr_static(thing, attribute, None))
    elif inspect.ismodule(thing):
        yield f"{name} (module)"
        for attribute in getattr(thing, "__all__", ()):
            yield from lines_of(f"{name}.{attribute}", getattr(thing, attribute))
    elif callable(thing):
        yield f"{name}{signature_of(thing)}"
    else:
        yield name


def member(name: str, thing: Any) -> Iterator[str]:
    """Line of an attribute of a class."""
    if isinstance(thing, staticmethod | classmethod):
        thing = thing.__func__
    yield f"{name}{signature_of(thing)}" if inspect.isroutine(thing) and callable(thing) else name


def signature_of(thing: Any) -> str:
    """Names and defaults of parameters, without annotations, which differ between versions of Python."""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    bare = [parameter.replace(annotation=inspect.Parameter.empty) for parameter in signature.parameters.values()]
    text = str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))
    return re.sub(r" at 0x[0-9a-f]+", "", text)


def test_the_public_names_are_those_that_are_listed():
    listed, found = LISTED.read_text().splitlines(), listing()
    changes = [line for line in difflib.ndiff(listed, found) if line[0] in "+-"]
    assert not changes, "the public interface changed:\n" + "\n".join(changes) + f"\nIf that is meant, renew {LISTED.name}: {RENEW}"


def test_the_root_has_the_engine_and_submodules_alone():
    assert set(stepper.__all__) == set(dir(stepper)) == ROOT | set(MODULES)


def test_earlier_names_are_gone_and_the_message_says_where_they_are():
    for place in sorted(set(MODULES) - {"adapters"}):
        for name in getattr(stepper, place).__all__:
            if not hasattr(stepper, name) and name not in ROOT_NAMES:
                with pytest.raises(AttributeError, match=rf"; use stepper\.\w+\.{name}$") as error:
                    getattr(stepper, name)
                module = str(error.value).split(".")[-2]
                assert hasattr(getattr(stepper, module), name)
    for name, hint in ROOT_NAMES.items():
        assert not hasattr(stepper, name)
        with pytest.raises(AttributeError, match=f"^module 'stepper' has no attribute {name!r}; use {re.escape(hint)}$"):
            getattr(stepper, name)


SLIPS = st.tuples(st.integers(0, 30), st.sampled_from(["drop", "double", "swap"]))
"""Place of a slip of the pen in a name, and its kind."""


def misspelt(name, place, slip):
    k = place % (len(name) - 1)
    return name[:k] + {"drop": "", "double": 2 * name[k], "swap": name[k + 1] + name[k]}[slip] + name[k + 1 + (slip == "swap") :]


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(["stepper", "stepper.envs"]), st.integers(0, 2**16), SLIPS)
def test_a_misspelt_name_in_an_import_has_a_suggestion(module, chosen, slip):
    """As the same name after a dot has it; no slip is the name of another submodule."""
    names = importlib.import_module(module).__all__
    # Of three letters or four, a slip leaves too little to recognise; private names are never suggested.
    long = [name for name in names if len(name) > 4 and not name.startswith("_")]
    name = long[chosen % len(long)]
    wrong = misspelt(name, *slip)
    assume(wrong not in names)
    with pytest.raises(ImportError, match=rf"^cannot import name {wrong!r} from '{module}'; (did you mean .*\b{name}\b.*\?|use .*)$"):
        exec(f"from {module} import {wrong}", {})
    with pytest.raises(AttributeError, match=rf"^module '{module}' has no attribute {wrong!r}; (did you mean .*\b{name}\b.*\?|use .*)$"):
        getattr(importlib.import_module(module), wrong)


def test_submodules_with_names_like_others_are_imported():
    """`loading` is like `load`, `_quantities` like nothing, and `terrain` no public name: none is an attribute before it was imported."""
    code = "from stepper import loading, _quantities; from stepper.envs import terrain; print(loading.__name__, terrain.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["stepper.loading", "stepper.envs.terrain"], done.stderr


def test_mask_of_randomize_is_a_hint():
    sim = stepper.Stepper(stepper.load("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>"))
    with pytest.raises(stepper.ModelError, match=r"Stepper\.randomize: there is no field 'mask'; did you mean envs"):
        sim.randomize(mask=None)


if __name__ == "__main__":
    LISTED.write_text("\n".join(listing()) + "\n")
