"""Definitions of studies: outcomes, parameters and names are checked, copies share a model, and policies and views of tasks are taken."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stepper
import stepper.policies
from checks import raises
from envs.test_terms import ROBOT, made
from stepper.envs import BatchView
from stepper.envs.quantities import base_height, base_linvel, gravity, joint_pos
from stepper.lab import Outcome, Parameter, Study, chart, rank, sweep, tune
from stepper.lab.study.batches import USUAL, begin, run_episodes, world_of
from stepper.lab.study.controllers import digest_of

ARM = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/><geom name="rod" size=".02" pos=".3 0 0"/>
  <site name="tip" pos=".3 0 0"/></body></worldbody><actuator><position name="servo" joint="hinge" kp="5"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
GIVEN = {
    "outcomes": Outcome(name="angle", measure="joint hinge", success="<= 0"),
    "parameters": {"mass": Parameter("body_mass[arm]", low=1, high=2)},
}
MJCF = "<mujoco><worldbody><body name='b'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
STUDY = """
model = "arm.xml"
policy = "servo.npz"
seconds = 0.2
episodes = 2
qpos_noise = 0.1
[[outcomes]]
name = "angle"
measure = "joint hinge"
"""
HINGED = """<mujoco><option timestep=".002"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/><geom size=".05" pos=".2 0 0"/>
  </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/><jointvel name="rate" joint="hinge"/></sensor></mujoco>"""


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
    raises((TypeError, ValueError), message, call, tmp_path)


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
    raises(ValueError, rf"arm.toml: {message}", Study.from_file, tmp_path / "arm.toml")


def test_a_model_is_no_study(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    raises(ValueError, r"arm.xml is no study: give a study's file, whose name ends in .toml or .py", Study.from_file, tmp_path / "arm.xml")


def test_a_study_and_its_copies_load_the_model_once():
    loads = []

    def model():
        loads.append(1)
        return stepper.load(MJCF)

    mass = {"m": Parameter("body_mass[b]", low=1.0, high=2.0)}
    study = Study(model=model, parameters=mass, outcomes=Outcome(name="z", measure="body b z"))
    copies = [replace(study, seed=1), study.at({"m": 1.5}), replace(study, parameters={}, settings={"f32": {"precision": "f32"}})]
    assert all(copy.loaded[0] == study.loaded[0] for copy in copies)
    assert len(loads) == 1


def test_another_model_is_loaded():
    study = Study(model=MJCF, parameters={"m": Parameter("body_mass[b]", low=1.0, high=2.0)})
    assert replace(study, model=MJCF.replace(".1", ".2")).loaded[0] != study.loaded[0]


# Policies of studies: files of `stepper.policies`, functions and objects with a memory.


def network(gain=-2.0):
    """tanh(gain (angle - 0.5) - rate / 2): a servo."""
    layer = (np.array([[gain], [-0.5]], np.float32), np.array([-0.5 * gain], np.float32))
    last = (np.ones((1, 1), np.float32), np.zeros(1, np.float32))
    one = np.ones(1)
    return stepper.policies.Policy(
        mean=np.zeros(2), std=np.ones(2), clip=10.0, layers=[layer, last], activation="tanh", low=-one, high=one, environment={}
    )


def test_a_policy_of_stepper_drives_a_study(tmp_path):
    (tmp_path / "arm.xml").write_text(HINGED)
    (tmp_path / "reach.toml").write_text(STUDY)
    network().save(tmp_path / "servo.npz")
    study = stepper.lab.Study.from_file(tmp_path / "reach.toml")
    found = stepper.lab.sweep(study, tmp_path / "out").sweep
    other = stepper.lab.sweep(replace(study, controller=stepper.lab.PolicyController(network())), tmp_path / "other").sweep
    assert [row["outcomes"] for row in found.table.rows] == [row["outcomes"] for row in other.table.rows]
    # What the file holds is what rows follow from, not where it is.
    (tmp_path / "copy").mkdir()
    network().save(tmp_path / "copy/servo.npz")
    again = stepper.lab.PolicyController(stepper.policies.load(tmp_path / "copy/servo.npz"))
    changed = stepper.lab.PolicyController(network(-3.0))
    assert digest_of(again) == digest_of(study.controller) != digest_of(changed)


class Integrator:
    """Controls that grow from one to the next."""

    def begin(self, now):
        self._sum = np.zeros((now.num_envs, 1))

    def __call__(self, seen):
        self._sum += 0.1 * (0.5 - seen[:, :1])
        return self._sum


def test_a_memory_is_of_one_batch(tmp_path):
    policy = stepper.lab.PolicyController(Integrator())
    assert angles(policy, tmp_path, 1) == angles(policy, tmp_path, 4)


def test_a_class_of_a_file_is_told_of_starts(tmp_path):
    (tmp_path / "arm.xml").write_text(HINGED)
    (tmp_path / "memory.py").write_text("""
class Count:
    def begin(self, now):
        self._count = 0

    def __call__(self, seen):
        self._count += 1
        return 0.01 * self._count + 0.0 * seen[:, :1]
""")
    (tmp_path / "reach.toml").write_text(STUDY.replace("servo.npz", "memory.py:Count"))
    study = stepper.lab.Study.from_file(tmp_path / "reach.toml")
    one, all_ = (stepper.lab.sweep(replace(study, batch=n), tmp_path / f"{n}").sweep.table.rows for n in (1, 2))
    assert [row["outcomes"] for row in one] == [row["outcomes"] for row in all_]


def world(engine, **given):
    study = Study(model=ROBOT, outcomes=[Outcome(name="height", measure=base_height)], keyframe="stance", seconds=0.1, **given)
    found = world_of(study, USUAL, [{}, {}], engine=engine)
    begin(study, found, [0, 1])
    return study, found


@pytest.mark.parametrize("engine", ["stepper", "mujoco"])
def test_quantities_of_a_robot_take_the_view_of_a_study(engine):
    """They equal those of a task in the same state bit for bit, because positions and velocities are the same numbers."""
    _, found = world(engine)
    assert isinstance(found, BatchView)
    np.testing.assert_allclose(joint_pos(found), 0.0, atol=1e-15)  # the stance, rounded once
    found.advance(np.zeros((2, 2)), 5)
    envs = made(2)
    envs.reset(seed=0)
    envs.set_state(qpos=found.qpos, qvel=found.qvel)
    for quantity in (base_height, base_linvel, gravity, joint_pos):
        np.testing.assert_array_equal(quantity(found), quantity(envs.now))
    assert base_linvel(found) is base_linvel(found)
    before = base_linvel(found)
    found.advance(None, 1)
    assert not np.array_equal(base_linvel(found), before)


def test_a_study_measures_the_height_of_a_base():
    """The trunk of 7 kg stays between 0.1 and 1 m for 0.1 s, because the servos hold the stance at 0.35 m."""
    study, _ = world("stepper")
    (row,) = run_episodes(study, USUAL, [{}], [0])
    assert 0.1 < row["outcomes"]["height"] < 1.0


def angles(drive: Any, folder: Path, batch: int = 64) -> list[float]:
    """Angle of the arm after each of four episodes from starts of their own, with a folder for every size of a batch."""
    study = stepper.lab.Study(
        model=HINGED,
        controller=drive,
        seconds=0.4,
        episodes=4,
        batch=batch,
        qpos_noise=0.3,
        outcomes=stepper.lab.Outcome(name="angle", measure="joint hinge"),
    )
    return [row["outcomes"]["angle"] for row in stepper.lab.sweep(study, folder / f"batches of {batch}").sweep.table.rows]
