"""`help` of everything public: said once, in the binary, and the same in the stub."""

import ast
import inspect

import pytest
import stepper
from stub_docs import STUB, documented, rewritten, spoken


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
