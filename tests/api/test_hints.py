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


SCRIPTS = {
    "mujoco": (
        (lambda: stepper.MjModel.from_xml_path("robot.xml"), "use stepper.load(path or text)"),
        (lambda: MODEL.from_xml_path, "use stepper.load(path or text)"),
        (lambda: stepper.MjData(MODEL), "use stepper.Stepper(model) for one environment"),
        (lambda: stepper.mj_resetDataKeyframe(MODEL, SIM, 0), "use sim.reset(keyframe=...)"),
        (lambda: SIM.load_keyframe, "use sim.reset(keyframe=...)"),
        (lambda: stepper.mj_step(MODEL, SIM), "use sim.step(ctrl)"),
        (lambda: stepper.mj_forward(MODEL, SIM), "all attributes follow from the state"),
        (lambda: stepper.mj_name2id(MODEL, 1, "box"), "use model.body(name).id"),
        (lambda: MODEL.opt.timestep, "model.timestep"),
        (lambda: MODEL.summary, "use model.explain()"),
        (lambda: MODEL.geom_bodyid, "use model.geom(name), which has it without the prefix"),
        (lambda: MODEL.jnt_qposadr, "use model.joint(name), which has it"),
        (lambda: MODEL.sensor_adr, "use model.sensor(name), which has it"),
        (lambda: MODEL.nsensor, "len(model.sensor_names)"),
        (lambda: MODEL.qpos, "use sim.qpos"),
        (lambda: SIM.geom_solref, "use sim.model.geom_solref"),
        (lambda: setattr(MODEL, "body_ipos", 0.0), "model.replace(body_ipos=...)"),
        (lambda: setattr(MODEL.geom("floor"), "friction", 0.3), "sim.randomize(geom_friction=...)"),
        (lambda: setattr(MODEL.joint("hip"), "axis", 1), "change the file"),
        (lambda: setattr(SIM, "ctrl", 0.1), "sim.step(ctrl) sets new controls"),
        (lambda: setattr(SIM, "qpos", 0.1), "sim.set_state(qpos=...) sets it"),
        (lambda: SIM.qpos.__setitem__(0, 0.1), "read-only"),
        (lambda: SIM.body("arm").xpos, "use sim.read('xpos', name) for values, or sim.model.body(name)"),
        (lambda: MODEL.body("arm").xpos, "use sim.read('xpos', name)"),
        (lambda: SIM.sensor("imu").data, "use sim.read('sensordata', name)"),
        (lambda: SIM.contact[0].geom1, "use sim.contacts()"),
        (lambda: SIM.contacts()["frc"], "no field of name frc"),
        (lambda: SIM.efc_force, "use sim.contacts()"),
        (lambda: SIM.xmat, "use sim.xquat"),
        (lambda: SIM.full_m, "use sim.mass_matrix()"),
        (lambda: SIM.set_keyframe("home"), "use sim.reset(keyframe=...)"),
        (lambda: SIM.energy[0], "sim.energy is a method: write sim.energy()"),
        (lambda: SIM.contacts.dist, "write sim.contacts().dist"),
        (lambda: SIM.add_force, "use sim.xfrc_applied of bodies and sim.qfrc_applied of joints"),
        (lambda: stepper.mj_contactForce(MODEL, SIM, 0), "use sim.contacts()['force']"),
        (lambda: SIM.jac_site, "use sim.jacobian(site=name)"),
        (lambda: SIM.jacobian("tip"), "but a site is: jacobian(site='tip')"),
        (lambda: SIM.mjd_transitionFD, "use sim.linearize()"),
        (lambda: stepper.launch_passive(MODEL, SIM), "use sim.view()"),
        (lambda: SIM.qpso, "did you mean qpos"),
        (lambda: SIM.geom_frictoin, "did you mean sim.model.geom_friction"),
    ),
    "gymnasium": (
        (lambda: stepper.make("stepper/Ant-v5"), "use gymnasium.make"),
        (lambda: stepper.envs.make("stepper/Ant-v5"), "use gymnasium.make"),
        (lambda: stepper.envs.HalfCheetah, "use stepper.envs.tasks.HalfCheetah"),
        (lambda: SIM.data.qpos, "has all arrays itself, as sim.qpos"),
        (lambda: SIM.frame_skip, "use sim.step(ctrl, nstep)"),
        (lambda: SIM.dt, "use sim.timestep"),
        (lambda: SIM.render, "use sim.view()"),
        (lambda: stepper.Study, "use stepper.lab.Study"),
    ),
    "batched": (
        (lambda: stepper.put_model(MODEL), "use stepper.load(path or text)"),
        (lambda: stepper.Stepper(MODEL, nworld=4), "use num_envs"),
        (lambda: stepper.Stepper(MODEL, 4, dt=0.002), "use options=stepper.Options(timestep=...)"),
        (lambda: stepper.Stepper(MODEL, 4, contact="mujoco"), "use options=stepper.Options(contact=...)"),
        (stepper.Recorder, "lacks the arguments sim and path; use sim.record(path)"),
        (lambda: stepper.load(SCENE, num_envs=4), "use stepper.Stepper(model, num_envs=...)"),
        (lambda: stepper.Options(dt=0.1), "use timestep"),
        (lambda: stepper.SensorModel(noise=0.1), "stepper.Transfer(noise_std=...)"),
        (lambda: stepper.ActuatorModel(kp=0.1), "stepper.Drive(servo=stepper.actuators.PID(kp=..., kd=...))"),
        (lambda: SIM.nworld, "use sim.num_envs"),
        (lambda: SIM.reset(mask=MASK), "Stepper.reset() takes no 'mask': use envs"),
        (lambda: SIM.rollout(np.zeros((2, 4, 1)), n_steps=2), "use nstep"),
        (lambda: SIM.get_state(envs=[0]), "use env, one environment"),
        (lambda: SIM.mass_matrix(env=0), "use mass_matrix()[env]"),
        (lambda: SIM.randomize(mask=MASK), "use envs"),
        (lambda: SIM.randomize(friction=0.5), "use geom_friction"),
        (lambda: SIM.randomize(kp=0.5), "use {'actuator_kp[name]': ...}"),
        (lambda: SIM.randomize({"friction[box]": 0.5}), "use geom_friction"),
        (lambda: SIM.body_mass, "use sim.model.body_mass"),
        (lambda: SIM.joint_pos, "use sim.qpos"),
        (lambda: SIM.obs, "use sim.sensordata"),
    ),
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_wrong_line_names_the_right_one(script):
    for line, (attempt, hint) in enumerate(SCRIPTS[script]):
        with pytest.raises((AttributeError, TypeError, ValueError, KeyError)) as error:
            attempt()
        assert hint in str(error.value), f"line {line}: {error.value}"


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
