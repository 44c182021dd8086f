"""Errors for names that users of MuJoCo, Gymnasium and batched simulators try: each names the call or attribute to use."""

import inspect
import re

import mujoco
import numpy as np
import pytest
import stepper
from stepper._hints import _guesses

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="arm" pos="1 0 1"><joint name="hip" axis="0 1 0"/>
  <geom name="arm" size=".1" pos=".3 0 0"/><site name="tip"/></body></worldbody><actuator><motor name="motor" joint="hip"/></actuator>
  <sensor><accelerometer name="imu" site="tip"/></sensor></mujoco>"""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL, 4)
ROOTS = {"sim": stepper.Stepper, "model": stepper.Model, "stepper": stepper, "mujoco": mujoco}


def absent_names(text):
    """Names and keywords after sim, model, stepper or mujoco in a text that do not exist."""
    wrong = []
    for root, path, after in re.findall(r"(?<![\w.])(sim|model|stepper|mujoco)\.([\w.]*\w)(\([^()]*)?", text):
        thing = ROOTS[root]
        for name in path.split("."):
            if name not in dir(thing) and not hasattr(thing, name):
                wrong.append(f"{root}.{path}")
                break
            if name == "adapters":  # Imports of its modules need other libraries.
                break
            thing = {"model": stepper.Model, "recorder": stepper.Recorder}.get(name) or getattr(thing, name)
        else:
            keywords = re.findall(r"(\w+)=", after)
            known = inspect.signature(thing).parameters if keywords else {}
            fields = any(one.kind is one.VAR_KEYWORD for one in known.values())
            wrong += [f"{root}.{path}({keyword}=)" for keyword in keywords if keyword not in known and not fields]
    return wrong


@pytest.mark.parametrize("section", _guesses())
def test_replacements_exist(section):
    for text in {*_guesses()[section].values()}:
        assert absent_names(text) == [], text


def test_names_of_the_engine_are_absent_from_it():
    for name in _guesses()["engine"]:
        assert not all(hasattr(owner, name) for owner in (stepper, SIM, MODEL)), name
    for section, owner in {"Model": MODEL, "Stepper": SIM, "State": SIM.get_state(), "Body": MODEL.body(1)}.items():
        assert [name for name in _guesses()[section] if hasattr(owner, name)] == []


OWNERS = {
    "engine": (stepper, SIM, MODEL), "Stepper": (SIM,), "Model": (MODEL,), "State": (SIM.get_state(),),
    "Body": (MODEL.body("arm"),), "Geom": (MODEL.geom("arm"),), "Joint": (MODEL.joint("hip"),), "Site": (MODEL.site("tip"),),
    "Sensor": (MODEL.sensor("imu"),),
}  # fmt: skip


@pytest.mark.parametrize("section", OWNERS)
def test_every_listed_attribute_is_answered_with_its_replacement(section):
    for name, text in _guesses()[section].items():
        for owner in (owner for owner in OWNERS[section] if not hasattr(owner, name)):
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            own = _guesses().get(type(owner).__name__, {}).get(name, text)
            assert own.removeprefix(": ") in str(error.value), (owner, name)


def test_every_listed_field_is_answered_with_its_replacement():
    for name, text in _guesses()["fields"].items():
        with pytest.raises(ValueError, match="there is no field") as error:
            SIM.randomize(**{name: 1.0})
        assert text.removeprefix(": ") in str(error.value), name


@pytest.mark.parametrize("name", ["contacts", "energy", "mass_matrix", "memory", "momentum", "worst_row"])
def test_a_method_without_parentheses_is_an_error_with_the_call(name):
    """Comparisons, sums, loops, texts and truth values of a method raise an error, because they were meant for its result."""
    method = getattr(SIM, name)
    for use in (
        *(bool, float, iter, len, np.asarray, np.sum, "{:.3f}".format),
        *(lambda x: x == 0.0, lambda x: x != 0.0, lambda x: x > 0.0, lambda x: x[0], lambda x: 2 * x, lambda x: x + 1, lambda x: 1 - x),
    ):
        with pytest.raises(TypeError, match=rf"^sim\.{name} is a method: write sim\.{name}\(\)$"):
            use(method)
    assert f"sim.{name}() calls it" in repr(method)
    assert inspect.signature(method) == inspect.signature(method.__wrapped__)
    assert method.__doc__ == getattr(stepper.Stepper, name).__doc__
    with pytest.raises(AttributeError, match=r"has no attribute|without an attribute '__array_interfac__'$"):
        getattr(method, "__array_interfac__")  # noqa: B009
