"""The public interface is the one that public_names.txt lists: a change of a name or a signature is a line of the diff.

After a change that is meant:

    PYTHONPATH=python:tests/helpers .venv/bin/python tests/api/test_public_names.py
"""

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

import stepper

LISTED = Path(__file__).with_name("public_names.txt")
RENEW = "PYTHONPATH=python:tests/helpers .venv/bin/python tests/api/test_public_names.py"
MODULES = stepper._SUBMODULES
ROOT = {
    *("load", "Model", "Stepper", "Options", "Status", "State", "ModelError", "ModelWarning", "SensorModel", "Transfer"),
    *("ActuatorModel", "Drive", "Recorder", "__version__"),
    *("add", "log_uniform", "normal", "scale", "uniform"),
}
"""Names of the engine, in `stepper` itself."""


def listing() -> list[str]:
    """All public names with signatures, sorted: of `stepper`, its submodules, and classes of the binary."""
    found = [line for name in ROOT for line in lines_of(f"stepper.{name}", getattr(stepper, name))]
    for module in MODULES:
        names = getattr(importlib.import_module(f"stepper.{module}"), "__all__", ())
        found += [f"stepper.{module}"]
        found += [line for name in names for line in lines_of(f"stepper.{module}.{name}", getattr(getattr(stepper, module), name))]
    elements = set(stepper._stepper.__all__) - ROOT - {"selected", *stepper.elements.__all__}
    found += [line for name in elements for line in lines_of(f"stepper._stepper.{name}", getattr(stepper._stepper, name))]
    return sorted(set(found))


def lines_of(name: str, thing: Any) -> Iterator[str]:
    """Lines of a name: with its signature, and of a class those of its methods, and one of its other public attributes."""
    if inspect.isclass(thing):
        yield f"{name}{signature_of(thing)}"
        if issubclass(thing, Flag):
            yield from (f"{name}.{flag.name} = {flag.value}" for flag in thing)
            return
        fields = getattr(thing, "__annotations__", {})
        # Members of base classes that are not public themselves.
        bases = [base for base in thing.__mro__ if base.__name__ in ("NamedParts", "Served", "Environment")]
        inherited = [name for base in bases for name in (*vars(base), *base.__annotations__) if name != "window"]
        members = {attribute for attribute in {*vars(thing), *fields, *inherited} if attribute[0] != "_"}
        methods = {key: method for key in members if (method := method_of(inspect.getattr_static(thing, key, None)))}
        yield from (f"{name}.{attribute}{signature_of(method)}" for attribute, method in methods.items())
        if attributes := sorted(members - methods.keys()):
            yield f"{name}: {' '.join(attributes)}"
    elif inspect.ismodule(thing):
        yield f"{name} (module)"
        for attribute in getattr(thing, "__all__", ()):
            yield from lines_of(f"{name}.{attribute}", getattr(thing, attribute))
    elif callable(thing):
        yield f"{name}{signature_of(thing)}"
    else:
        yield name


def method_of(thing: Any) -> Any:
    """Function of an attribute of a class that is a method, or None."""
    function = thing.__func__ if isinstance(thing, staticmethod | classmethod) else thing
    return function if inspect.isroutine(function) and callable(function) else None


def signature_of(thing: Any) -> str:
    """Names and defaults of parameters, without annotations, which differ between versions of Python."""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    bare = [one.replace(annotation=inspect.Parameter.empty) for one in signature.parameters.values() if not one.name.startswith("_")]
    return re.sub(r" at 0x[0-9a-f]+", "", str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty)))


def test_the_public_names_are_those_that_are_listed():
    listed, found = LISTED.read_text().splitlines(), listing()
    changes = [line for line in difflib.ndiff(listed, found) if line[0] in "+-"]
    assert not changes, "the public interface changed:\n" + "\n".join(changes) + f"\nIf that is meant, renew {LISTED.name}: {RENEW}"


def test_the_root_has_the_engine_and_submodules_alone():
    assert set(stepper.__all__) == set(dir(stepper)) == ROOT | set(MODULES)


def test_submodules_with_names_like_others_are_imported():
    """`loading` is like `load`, `_quantities` like nothing, and `terrain` no public name: none is an attribute before it was imported."""
    code = "from stepper import loading, _quantities; from stepper.envs import terrain; print(loading.__name__, terrain.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["stepper.loading", "stepper.envs.terrain"], done.stderr


if __name__ == "__main__":
    LISTED.write_text("\n".join(listing()) + "\n")
