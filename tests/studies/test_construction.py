"""A study is checked when it is made: outcomes, parameters, and the names in them."""

from dataclasses import replace

import numpy as np
import pytest
import stepper
from stepper.lab import Outcome, Parameter, Study, chart, rank, sweep, tune

ARM = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/><geom name="rod" size=".02" pos=".3 0 0"/>
  <site name="tip" pos=".3 0 0"/></body></worldbody><actuator><position name="servo" joint="hinge" kp="5"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
GIVEN = {
    "outcomes": Outcome(name="angle", measure="joint hinge", success="<= 0"),
    "parameters": {"mass": Parameter("body_mass[arm]", low=1, high=2)},
}


def words(measure):
    return Outcome(name="x", measure=measure)


@pytest.mark.parametrize(("given", "kind", "parts"), [
    ({"outcome": []}, TypeError, ["unexpected keyword argument 'outcome'"]),
    ({"outcomes": []}, ValueError, ["outcomes is []", "no outcome"]),
    ({"outcomes": "body arm z"}, TypeError, ["outcomes is 'body arm z'", "stepper.lab.Outcome"]),
    ({"outcomes": ["body arm z"]}, TypeError, ["outcomes has 'body arm z'", "Outcome(name=..., measure=...)"]),
    ({"outcomes": [words("body amr z")]}, ValueError, ["outcome 'x'", "'body amr z'", "did you mean arm"]),
    ({"outcomes": [words("site hand z")]}, ValueError, ["outcome 'x'", "no site 'hand'", "tip"]),
    ({"outcomes": [words("joint hing")]}, ValueError, ["outcome 'x'", "did you mean hinge"]),
    ({"outcomes": [words("jointvel hing")]}, ValueError, ["outcome 'x'", "did you mean hinge"]),
    ({"outcomes": [words("sensor angel 0")]}, ValueError, ["outcome 'x'", "did you mean angle"]),
    ({"outcomes": [words("force amr z")]}, ValueError, ["outcome 'x'", "did you mean arm"]),
    ({"parameters": [Parameter("gravity[2]", low=-10, high=-9)]}, TypeError, ["parameters is [", "a dict of stepper.lab.Parameter"]),
    ({"settings": {"fast": "euler"}}, TypeError, ["settings 'fast' is 'euler'", "must be a dict"]),
    ({"settings": ["euler"]}, TypeError, ["settings is ['euler']", "must be a dict"]),
    ({"parameters": {"g": (0, 1)}}, TypeError, ["parameter 'g' is (0, 1)", "stepper.lab.Parameter"]),
    (
        {"parameters": {"m": Parameter("body_mass[amr]", low=1, high=2)}},
        ValueError,
        ["parameter 'm'", "body_mass[amr]", "did you mean arm"],
    ),
    (
        {"parameters": {"m": Parameter("body_mas[arm]", low=1, high=2)}},
        ValueError,
        ["parameter 'm'", "body_mas", "did you mean body_mass"],
    ),
    ({"seed": -1}, ValueError, ["seed is -1, must be a whole number of at least 0"]),
    ({"precision": "f16"}, ValueError, ["did you mean"]),
    ({"parameters": {"d": Parameter("sensor.delay[angel]", low=0, high=1)}}, ValueError, ["parameter 'd'", "did you mean angle"]),
    ({"parameters": {"d": Parameter("actuator.delay[sevro]", low=0, high=1)}}, ValueError, ["parameter 'd'", "did you mean servo"]),
])  # fmt: skip
def test_what_is_wrong_is_named_at_once(given, kind, parts):
    for model in (ARM, stepper.load(ARM), lambda: ARM):
        with pytest.raises(kind) as error:
            Study(model=model, **given)
        assert all(part in str(error.value) for part in parts), str(error.value)
    if "outcome" not in given:
        with pytest.raises(kind) as error:
            replace(Study(model=ARM), **given)
        assert all(part in str(error.value) for part in parts), str(error.value)


@pytest.mark.parametrize(("own", "parts"), [
    ({"engine": "mujoco", "cones": "elliptic"}, ["no setting 'cones'", "did you mean cone?"]),
    ({"engine": "mujoco", "cone": "eliptic"}, ["no cone 'eliptic'", "did you mean elliptic?", "pyramidal"]),
    ({"engine": "mujoco", "iterations": 2.5}, ["iterations is 2.5", "a whole number of at least 0"]),
    ({"engine": "mujoco", "timestep": 0}, ["timestep is 0", "a number above 0"]),
    ({"engine": "mujoco", "tolerance": "1e-8"}, ["tolerance is '1e-8'", "a number of at least 0"]),
    ({"cone": "elliptic"}, ["unknown ['cone']", 'add engine = "mujoco"']),
    ({"contact": "mujco"}, ["contact is 'mujco'", "did you mean mujoco?"]),
    ({"precision": "f16"}, ["precision is 'f16'", "'f32'"]),
])  # fmt: skip
def test_settings_are_checked_before_any_episode(own, parts):
    with pytest.raises(ValueError, match="settings 'other'") as error:
        Study(model=ARM, settings={"other": own})
    assert all(part in str(error.value) for part in parts), str(error.value)


def arm():
    return Study(model=ARM, **GIVEN)


@pytest.mark.parametrize(("call", "message"), [
    (lambda out: Parameter("gravity[2]", values=3.0), "values is 3.0, must be a list of values"),
    (lambda out: Parameter("gravity[2]", low=-10.0, high=-9.0, nominal=[]), r"nominal of 'gravity\[2\]' has \[\], must be finite numbers"),
    (lambda out: Parameter("gravity[2]", low=-10.0, high=-9.0, nominal=np.nan), r"nominal of 'gravity\[2\]' has nan, must be finite"),
    (lambda out: Parameter("gravity[2]", low=-10.0, high=-9.0, values=[(1, 2)]), r"values of 'gravity\[2\]' has \(1, 2\), must be finite"),
    (lambda out: Study(model=ARM, name=3), "name is 3, must be a text"),
    (lambda out: Study(model=ARM, seconds="1.5"), "seconds is '1.5', must be a number"),
    (lambda out: Study(model=ARM, control=[0.02, -1.0]), r"control is \[0.02, -1.0\], must be a number"),
    (lambda out: Study(model=ARM, qvel_noise="much"), "qvel_noise is 'much', must be a number"),
    (lambda out: Study(model=ARM, episodes=2.5), "episodes is 2.5, must be a whole number"),
    (lambda out: Study(model=ARM, batch=np.array([8, 16])), r"batch is array\(\[ 8, 16\]\), must be a whole number"),
    (lambda out: Study(model=ARM, options={"timestep": 0.01}), r"options is .*, must be a stepper.Options: write stepper.Options"),
    (lambda out: Study(model=ARM, sensors={"hinge": 0.1}), "sensors is .*, must be a stepper.SensorModel: write"),
    (lambda out: Outcome(name="a", measure="joint hinge", success=0.2), r"outcome 'a': success is 0\.2, must be a comparison such as"),
    (lambda out: Outcome(name=3, measure="joint hinge"), "the name of an Outcome is 3, must be a text"),
    (lambda out: Outcome(name="x", measure="joint hinge", unit=3), "outcome 'x': unit is 3, must be a text"),
    (lambda out: Outcome(name="x", measure="joint hinge", margin="small"), "outcome 'x': margin is 'small', must be a number"),
    (lambda out: arm().at("mass"), "values is 'mass', must be a dict"),
    (lambda out: arm().episode("mass"), "values is 'mass', must be a dict"),
    (lambda out: arm().episode(record=3), r"record is 3 \(int\), must be a path"),
    (lambda out: replace(arm(), outcomes=Outcome(name="x", measure=lambda now: {})).episode(), "outcome 'x': the measure is {}"),
    (lambda out: Study.from_file(3), r"path is 3 \(int\), must be a path"),
    (lambda out: sweep(3, out), r"study is 3 \(int\), must be a stepper.lab.Study or the path"),
    (lambda out: sweep(arm(), 3), r"out is 3 \(int\), must be a path"),
    (lambda out: sweep(arm(), out, parameters="mass"), "parameters is 'mass', must be a list of names or selectors"),
    (lambda out: sweep(arm(), out, resolution="fine"), "resolution is 'fine', must be a number"),
    (lambda out: rank(arm(), out, setting=[]), r"setting is \[\], must be the name of settings"),
    (lambda out: chart(arm(), out, episodes="8"), "episodes is '8', must be a whole number of at least 1"),
    (lambda out: tune(arm(), out, error="1 mm", horizon="1 s", coverage="0.9"), "coverage is '0.9', must be a number"),
])  # fmt: skip
def test_arguments_of_another_type_are_named(tmp_path, call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call(tmp_path)


def test_settings_of_mujoco_run():
    every = {"integrator": "implicitfast", "cone": "elliptic", "solver": "newton", "impratio": 2, "noslip_iterations": 0, "iterations": 9}
    study = Study(model=ARM, settings={"other": {"engine": "mujoco", "tolerance": 0, "timestep": 0.001} | every}, seconds=0.1)
    used = study.episode(setting="other")["settings"]
    assert {name: used[name] for name in every} == every


def test_a_study_without_names_loads_nothing():
    Study(model="there_is_no_such_file.xml", parameters={"h": Parameter("options.timestep", values=(0.001, 0.002))})


@pytest.mark.parametrize(("text", "message"), [
    ("outcomes = 3", r"outcomes is 3, must be tables: begin each with the line \[\[outcomes\]\]"),
    ("parameters = 3", "parameters is 3, must be tables"),
    ('[[outcomes]]\nname = "x"', "outcome 1 has no measure: add measure = ..."),
    ("[parameters.g]\nlow = 1", "parameter 'g' has no selector: add selector = ..."),
    ('[options]\ntimestep = "x"', "options: option timestep is 'x'"),
    ("[settings]\nfast = 3", "settings 'fast' is 3, must be a dict"),
])  # fmt: skip
def test_wrong_entries_of_files_are_named(tmp_path, text, message):
    (tmp_path / "arm.toml").write_text(f'model = """{ARM}"""\n{text}\n')
    with pytest.raises(ValueError, match=rf"arm.toml: {message}"):
        Study.from_file(tmp_path / "arm.toml")


def test_a_model_is_no_study(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    with pytest.raises(ValueError, match=r"arm.xml is no study: give a study's file, whose name ends in .toml or .py"):
        Study.from_file(tmp_path / "arm.xml")
