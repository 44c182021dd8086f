"""Errors for names that users of MuJoCo, Gymnasium and batched simulators try: each names the call or attribute to use."""

import inspect
import re
from collections import Counter

import mujoco
import numpy as np
import pytest
import stepper
import stepper.envs
from stepper._hints import _guesses, replacements
from stepper.shared.fields import RANDOMIZED

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="arm" pos="1 0 1"><joint name="hip" axis="0 1 0"/>
  <geom name="arm" size=".1" pos=".3 0 0"/><site name="tip"/></body></worldbody><actuator><motor name="motor" joint="hip"/></actuator>
  <sensor><accelerometer name="imu" site="tip"/></sensor></mujoco>"""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL, 4)
MASK = np.array([True, False, False, True])
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
def test_replacements_exist_and_names_are_listed_once(section):
    for text in {*replacements(section).values()}:
        assert absent_names(text) == [], text
    names = Counter(name for names in _guesses()[section].values() for name in names.split())
    assert [name for name, count in names.items() if count > 1] == []


def test_names_of_the_engine_are_absent_from_it():
    for name in replacements("engine"):
        assert not all(hasattr(owner, name) for owner in (stepper, SIM, MODEL)), name
    for section, owner in {
        "Model": MODEL,
        "Stepper": SIM,
        "State": SIM.get_state(),
        "Body": MODEL.body(1),
        "Options": stepper.Options(),
    }.items():
        assert [name for name in replacements(section) if hasattr(owner, name)] == []


OWNERS = {
    "engine": (stepper, SIM, MODEL), "Stepper": (SIM,), "Model": (MODEL,), "State": (SIM.get_state(),), "Options": (stepper.Options(),),
    "Body": (MODEL.body("arm"),), "Geom": (MODEL.geom("arm"),), "Joint": (MODEL.joint("hip"),), "Site": (MODEL.site("tip"),),
    "Sensor": (MODEL.sensor("imu"),),
}  # fmt: skip


@pytest.mark.parametrize("section", OWNERS)
def test_every_listed_attribute_is_answered_with_its_replacement(section):
    for name, text in replacements(section).items():
        for owner in (owner for owner in OWNERS[section] if not hasattr(owner, name)):
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            own = replacements(type(owner).__name__).get(name, text)
            assert own.removeprefix(": ") in str(error.value), (owner, name)


@pytest.mark.parametrize(("attempt", "hint"), [
    (lambda: MODEL.opt.timestep, "model.timestep"),
    (lambda: MODEL.geom_bodyid, "use model.geom(name), which has it without the prefix"),
    (lambda: MODEL.qpos, "use sim.qpos"),
    (lambda: SIM.geom_solref, "use sim.model.geom_solref"),
    (lambda: MODEL.body("arm").xpos, "use sim.read('xpos', name)"),
    (lambda: SIM.contacts()["frc"], "no field of name frc"),
    (lambda: SIM.contacts.dist, "write sim.contacts().dist"),
    (lambda: SIM.jacobian("tip"), "but a site is: jacobian(site='tip')"),
    (lambda: SIM.qpso, "did you mean qpos"),
    (lambda: SIM.geom_frictoin, "did you mean sim.model.geom_friction"),
    (lambda: setattr(MODEL.joint("hip"), "axis", 1), "change the file"),
    (stepper.Recorder, "lacks the arguments sim and path; use sim.record(path)"),
    (lambda: SIM.randomize(kp=0.5), "use {'actuator_kp[name]': ...}"),
    (lambda: SIM.randomize({"friction[box]": 0.5}), "use geom_friction"),
])  # fmt: skip
def test_a_name_that_is_not_listed_has_a_hint(attempt, hint):
    with pytest.raises((AttributeError, TypeError, ValueError, KeyError)) as error:
        attempt()
    assert hint in str(error.value)


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


def test_methods_of_quantities_without_arguments_have_hints():
    """All methods of a stepper that run without arguments, apart from those that act and those that read a state."""
    runs = {
        name
        for name in dir(stepper.Stepper)
        if name[0] != "_"
        and callable(method := getattr(stepper.Stepper, name))
        and all(one.default is not one.empty for one in list(inspect.signature(method).parameters.values())[1:])
    }
    acting = {"copy_state", "get_state", "linearize", "observe", "reset", "set_state", "step"}
    found = {name for name in runs if "calls it" in repr(getattr(SIM, name))}
    assert found == runs - acting - {"jacobian"}


@pytest.mark.parametrize("owner", [SIM, MODEL, stepper, stepper.recording, stepper.Options(), MODEL.body("arm")])
def test_special_names_of_python_have_no_hint(owner):
    with pytest.raises(AttributeError, match=r"has no attribute '__array_interfac__'$"):
        getattr(owner, "__array_interfac__")  # noqa: B009


def test_attributes_of_one_class_are_hints_of_the_other():
    for owner, other, place in ((MODEL, stepper.Stepper, "sim."), (SIM, stepper.Model, "model.")):
        for name in {name for name in dir(other) if name[0] != "_"} - {*dir(owner)} - {*replacements("Stepper"), *replacements("engine")}:
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            assert f"{place}{name}" in str(error.value)


@pytest.mark.parametrize("field", sorted(RANDOMIZED))
def test_fields_of_randomize_are_hints_of_a_stepper(field):
    """Reading and assigning: the values of an environment are not those of the model."""
    for attempt in (lambda: getattr(SIM, field), lambda: setattr(SIM, field, 1.0)):
        with pytest.raises(AttributeError, match=rf"sim\.model\.{field}"):
            attempt()


@pytest.mark.parametrize("module", ["actuators", "derivatives", "recording", "sensors", "sysid", "viewer", "envs"])
def test_a_submodule_lists_its_names(module):
    there = getattr(stepper, module)
    with pytest.raises(
        AttributeError, match=rf"^module 'stepper\.{module}' has no attribute 'qqq'; there are: {', '.join(there.__all__)}$"
    ):
        _ = there.qqq
